"""Recordings: what they hold, what can be saved of them, other formats, and how they are played."""
