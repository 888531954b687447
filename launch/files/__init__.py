"""Files that users hand over or get: YAML, meshes, points, saved solids, calibrations.

Everything read here is distrusted: sizes and counts are bounded before memory is taken, and every
complaint is an `InputError` of one sentence. A new mesh format is one reader in `READERS`, a new
points format one in `points_file`. Rests on palpate.core, and for recordings and calibrations on
palpate.messages and palpate.nodes; on nothing of launch.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.launch.files.file_access import FileWriter, check_new, file_within, plain_name
    from palpate.launch.files.file_access import read_bounded, write_atomically, write_new
    from palpate.launch.files.mesh_file import MAX_EXTENT, MAX_FACES, MAX_MESH_BYTES, MESH_UNITS
    from palpate.launch.files.mesh_file import MIN_EXTENT, MeshFile, export_model
    from palpate.launch.files.mesh_file import is_mesh_file, mesh_sha256, read_cloud, read_mesh
    from palpate.launch.files.mesh_file import read_surface, uncertainties, write_mesh
    from palpate.launch.files.point_clouds import MeasuredContours
    from palpate.launch.files.points_file import read_oriented, read_points, read_positions
    from palpate.launch.files.points_file import read_tops, read_touches, recording_of
    from palpate.launch.files.solid_file import LATTICE_SUFFIXES, SOLID_SUFFIX, load, read_npz, save
    from palpate.launch.files.solid_file import write_lattice
    from palpate.launch.files.source_map import InputError, KeyPath, SourceMapped, as_input_errors
    from palpate.launch.files.source_map import hint, key_path, path_text, set_within
    from palpate.launch.files.units import METRES_PER_UNIT, OWN_UNITS
    from palpate.launch.files.yaml_file import convert, parse_yaml, read_yaml, yaml_text
else:
    __getattr__, __dir__ = lazy(__name__)
