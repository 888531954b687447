"""Descriptions in parameters of nodes and scenes: objects, sensors, effects and tactile frames.

They check their ranges, and have the defaults. A new solid is a structure with a method `build` in
`objects` or `primitives`. This package uses `palpate.core.shapes` and `palpate.core.touch`.
"""
