"""Files that users hand over or get: YAML, meshes, points, saved solids, calibrations.

Everything read here is distrusted: sizes and counts are bounded before memory is taken, and every
complaint is an `InputError` of one sentence. A new mesh format is one reader in `READERS`, a new
points format one in `points_file`. Rests on palpate.core, and for recordings and calibrations on
palpate.messages and palpate.nodes; on nothing of launch.
"""
