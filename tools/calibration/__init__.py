"""Calibration of the taxels of a sensor from presses of a known flat and a known ball.

Optional: registered as a command by its entry point.
"""
