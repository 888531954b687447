"""What the reconstructor node has received, and the solids and messages that it makes of it.

`received` keeps the messages, `fitting` fits or continues the solids of a set, and `candidates`
chooses the solid that predicted touches better and writes the message. Tuned values are fields of
`ReconstructorSettings`, which the state carries.
The package uses `palpate.core.rebuild`; the reconstructor node and readers of files use it.
"""
