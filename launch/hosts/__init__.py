"""Other machines: their addresses and key, the nodes that run there, and the agent of a machine.

The package is optional, and is found by entry points. Only the key file decides who may start
processes: read docs/bus.md before changing that. Nodes end when the launcher ends or is silent.
"""
