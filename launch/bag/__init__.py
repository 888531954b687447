"""Recordings as files: what is in them, what can be saved of them, and other formats."""
