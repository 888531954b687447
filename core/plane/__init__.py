"""Figures in the plane: what contours enclose, and what fits into them."""
