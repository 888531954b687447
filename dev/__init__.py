"""Tools for changing palpate, which are not installed; only tests import them.

``python -m dev.mutation``, ``dev.fuzz``, ``dev.chaos``, ``dev.house`` and ``dev.plain``, each with
``--help``.
"""
