"""Where to touch next: tracing a contour, and planning the slices."""
