"""From weights to poses, Jacobians and twists."""
