"""Damaged input, made from seeds, and what the readers make of it.

Messages, recordings, meshes, scenes and saved solids are damaged in many ways and read. A reader
may refuse with its one error, or accept what is valid; all else is a defect.
"""
