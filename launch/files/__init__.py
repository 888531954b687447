"""Files that users hand over or get: YAML, meshes, points, saved solids, calibrations.

Everything read here is distrusted: sizes and counts are bounded before memory is taken, and every
complaint is an `InputError` of one sentence. A new mesh format is one reader in `READERS`, a new
points format one in `points_file`. Rests on palpate.core, and for recordings and calibrations on
palpate.messages and palpate.nodes; on nothing of launch.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.launch.files.file_access import FileWriter as FileWriter
    from palpate.launch.files.file_access import check_new as check_new
    from palpate.launch.files.file_access import file_within as file_within
    from palpate.launch.files.file_access import read_bounded as read_bounded
    from palpate.launch.files.file_access import write_atomically as write_atomically
    from palpate.launch.files.file_access import write_new as write_new
    from palpate.launch.files.mesh_file import MAX_EXTENT as MAX_EXTENT
    from palpate.launch.files.mesh_file import MAX_FACES as MAX_FACES
    from palpate.launch.files.mesh_file import MAX_MESH_BYTES as MAX_MESH_BYTES
    from palpate.launch.files.mesh_file import MESH_UNITS as MESH_UNITS
    from palpate.launch.files.mesh_file import METRES_PER_UNIT as METRES_PER_UNIT
    from palpate.launch.files.mesh_file import MIN_EXTENT as MIN_EXTENT
    from palpate.launch.files.mesh_file import MeshFile as MeshFile
    from palpate.launch.files.mesh_file import export_model as export_model
    from palpate.launch.files.mesh_file import is_mesh_file as is_mesh_file
    from palpate.launch.files.mesh_file import mesh_sha256 as mesh_sha256
    from palpate.launch.files.mesh_file import read_cloud as read_cloud
    from palpate.launch.files.mesh_file import read_mesh as read_mesh
    from palpate.launch.files.mesh_file import read_surface as read_surface
    from palpate.launch.files.mesh_file import write_mesh as write_mesh
    from palpate.launch.files.point_clouds import MeasuredContours as MeasuredContours
    from palpate.launch.files.points_file import read_points as read_points
    from palpate.launch.files.points_file import read_tops as read_tops
    from palpate.launch.files.solid_file import LATTICE_SUFFIXES as LATTICE_SUFFIXES
    from palpate.launch.files.solid_file import SOLID_SUFFIX as SOLID_SUFFIX
    from palpate.launch.files.solid_file import load as load
    from palpate.launch.files.solid_file import read_npz as read_npz
    from palpate.launch.files.solid_file import save as save
    from palpate.launch.files.solid_file import write_lattice as write_lattice
    from palpate.launch.files.source_map import InputError as InputError
    from palpate.launch.files.source_map import KeyPath as KeyPath
    from palpate.launch.files.source_map import SourceMapped as SourceMapped
    from palpate.launch.files.source_map import as_input_errors as as_input_errors
    from palpate.launch.files.source_map import hint as hint
    from palpate.launch.files.source_map import key_path as key_path
    from palpate.launch.files.source_map import set_within as set_within
    from palpate.launch.files.yaml_file import convert as convert
    from palpate.launch.files.yaml_file import parse_yaml as parse_yaml
    from palpate.launch.files.yaml_file import read_yaml as read_yaml
    from palpate.launch.files.yaml_file import yaml_text as yaml_text
else:
    __getattr__, __dir__ = lazy(__name__)
