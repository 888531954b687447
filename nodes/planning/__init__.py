"""Conversions between messages and models of the core, for planner, collector and forecast.

The decisions of an exploration are made in `palpate.core.explore`.
"""
