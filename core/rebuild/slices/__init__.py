"""Contours as level slices of an object, and what is wrong with them."""
