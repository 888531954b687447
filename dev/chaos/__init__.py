"""Fault injection: explorations in which processes are killed and stopped, and judged after.

Kinds of fault and their timing may be changed in `fault_injection`; `history` shares no code with
what it judges, and should not. Rests on launch.processes and the command line, as a user does.
"""
