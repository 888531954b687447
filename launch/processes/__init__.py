"""The processes of a running graph: they are started, watched, restarted and ended.

`supervisor` runs a graph from start to end. The times after which a node is silent or hangs, or a
graph has stalled, are fields of `SupervisionSettings` and `HostSettings`, and parameters of
`Watchdog`. This package uses `palpate.messages.bus` and `palpate.nodes.runtime`.
"""
