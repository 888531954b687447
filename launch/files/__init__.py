"""Files that users give or receive: YAML, meshes, points, saved solids, calibrations.

All input is untrusted: sizes and counts are checked before memory is allocated, and each error is
an `InputError` of one sentence. A new mesh format is a reader in `mesh_file.READERS`, a new points
format one in `points_file.POINT_READERS`. This package uses `palpate.core`, and for recordings
`palpate.messages` and `palpate.nodes`, but no other part of `palpate.launch`.
"""
