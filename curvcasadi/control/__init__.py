"""Models as a control engineer sees them: x, u, p, y."""
