"""Knots and bases, and the volumes that they deform."""
