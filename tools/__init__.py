"""Tools for graphs, runs and recordings: each is one module or one package.

Each may be changed or left out by itself; no lower package imports it.
Rests on palpate.launch; the command line in tools.cli calls it.
"""
