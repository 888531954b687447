"""What palpate knows: arrays in, arrays out; no clock, file, socket, log or global state.

These chapters serve all its rooms: array types and their checks, poses, batched least squares,
archives of values, plug-ins and their parameters, what moves cost a robot, and steps of long work.
Only the presets of `robot_time` are assumptions, to be replaced. They rest on numpy alone.
"""
