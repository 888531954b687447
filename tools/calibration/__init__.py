"""What each taxel means, estimated from presses of a known flat and a known ball.

Optional: found as a command by its entry point.
"""
