"""Effects that disturb a touch, one a file; nothing here is imported that no scene lists.

A module of this package holds one description of an effect under the name ``EFFECT``.
"""
