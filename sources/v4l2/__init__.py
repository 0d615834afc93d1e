"""V4L2 cameras as a source, over the kernel's own interface."""
