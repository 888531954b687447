"""Graphs on several machines: one lends itself, a launcher on another one has nodes there."""
