"""Definition of nodes, and running them: in processes, composed in one process, or in tests.

All ways of running use the same steps, and handle messages in the same order. Times are fields of
`LoopSettings` and `SourceSettings`. This package uses `palpate.messages`, and is the only part of
`palpate.nodes` that reads a clock.
"""
