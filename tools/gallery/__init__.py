"""The figures of Fung's thesis (1999), drawn anew by palpate's code, and some of palpate's own.

Each chapter of the thesis is a module; each figure is a function that returns a picture, and
`sheet` has the table of all. What may be changed are views, sizes and colours, in `style`; a figure
computes nothing itself that palpate can compute. Rests on palpate.core, palpate.launch and the
rasteriser of palpate.tools.view.
"""
