"""Fung's own way from contours to a solid (1999, chapter 4), to compare others with.

A superquadric is put into a control lattice, and the lattice is deformed: its shell is made of
the control polygons of the contours, one layer each, its core of what fits inside them.
"""
