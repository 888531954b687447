"""Algorithms of palpate: arrays in, arrays out; no clock, file, socket, log or global state.

The modules here serve all its packages: array types and their checks, poses, batched least squares,
archives of values, plug-ins and their parameters, robot time, and steps of long computations. They
depend on numpy alone. Only the presets of `robot_time` are assumptions, to be replaced.
"""
