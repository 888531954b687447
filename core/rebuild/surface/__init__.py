"""A closed surface, exact at every place: points, meshes, measures, nearest points."""
