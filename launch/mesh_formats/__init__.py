"""Readers of mesh formats, one a file: bytes to plain arrays, in time that grows with them alone.

No count that a file states is believed before the file is seen to be long enough for it. Each
reader raises ValueError, whose text is the rest of a sentence about the file.
"""
