"""Looking at a running graph: its topics by taps, its launcher by requests, its machine.

Copies may be lost on the way to a tool, the graph itself is never held up; patience and print
intervals may be tuned. Rests on launch.processes (which graphs run) and on palpate.messages.bus.
"""
