"""Faults put into running explorations, and what becomes of them."""
