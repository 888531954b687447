"""What the reconstructor node has received, and the solids and messages that it makes of it.

`fitting` says what belongs to a set and makes or continues its solids, `candidates` chooses between
them by how they predicted, and writes the message. To be tuned: how surely a general
solid must predict better, and after how many touches it is fitted anew. Rests on
`palpate.core.rebuild`; used by the reconstructor node, and by those who rebuild from files.
"""
