"""What parameters of nodes and scenes describe.

Objects, sensors, effects, files of tactile frames. To be touched: ranges and defaults of the
structures, which check what they are given; a new solid is a structure and a `build_` function in
`solids`. Rests on `palpate.core.shapes` and `palpate.core.touch`, imported when a scene needs them.
"""
