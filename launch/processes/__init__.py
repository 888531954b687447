"""The processes of a running graph: started, watched, started again, ended without a trace.

The supervisor knows the life of a run; the times after which a node counts as silent, hung or
stalled are constants at the top of each chapter and may be tuned. Rests on palpate.messages.bus
and on the runtime of palpate.nodes.
"""
