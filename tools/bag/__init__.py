"""Recordings as files: what they hold, recovery, differences, export and playback.

Formats of export may be added in `FORMATS`. Rests on messages.recording and, to play, on launch.
"""
