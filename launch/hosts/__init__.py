"""Other machines: their addresses and the key, nodes that run there, and the agent that lends one.

Optional: found by entry points. Only the key file decides who may start processes: change nothing
there without reading docs/bus.md. Nodes end with the launcher's word, or when it is silent.
"""
