"""Looking at a running graph: topics through taps, the launcher by requests, and the machine.

Copies may be lost on the way to a tool, but the graph is never delayed; waits and print intervals
may be tuned. Rests on launch.processes (which graphs run) and on palpate.messages.bus.
"""
