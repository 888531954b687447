"""Fault injection: explorations in which processes are killed and stopped, and then examined.

Faults and their times are drawn in `fault_injection`. `history` must share no code with what it
checks. Uses launch.processes and the command line, as a user does.
"""
