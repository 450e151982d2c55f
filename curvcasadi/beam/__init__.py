"""What a beam is: basis, grid, section, pose, and its mirror image."""
