"""Tools for changing palpate: none of it is installed, and only tests import it.

``python -m dev.mutation``, ``dev.fuzz``, ``dev.chaos`` and ``dev.house``, each with ``--help``.
"""
