"""What `palpate bench` runs.

Groups of measurements by name, the shipped scenes, single calls. A measurement of your own is
added to a table of `groups`. It rests on all other rooms of bench.
"""
