"""A run as a film: moments of its timeline, drawn without a screen.

Optional: found as a command by its entry point, and imported by nothing else.
"""
