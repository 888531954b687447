"""How a solid goes on beyond its first and last contours."""
