"""What palpate knows: arrays in, arrays out; no clock, file, socket, log or global state.

These chapters serve all its rooms: array types and their checks, poses, batched least squares,
archives of values, plug-ins and their parameters, what moves cost a robot, and steps of long work.
Of them only the presets of `robot_time` are assumptions that may be replaced; the rest is to be
relied on. They rest on numpy alone.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.archive import FORM_KEY as FORM_KEY
    from palpate.core.archive import arrays_from_bytes as arrays_from_bytes
    from palpate.core.archive import tree_from_arrays as tree_from_arrays
    from palpate.core.archive import tree_to_arrays as tree_to_arrays
    from palpate.core.archive import tree_to_bytes as tree_to_bytes
    from palpate.core.arrays import Bools as Bools
    from palpate.core.arrays import Floats as Floats
    from palpate.core.arrays import Ints as Ints
    from palpate.core.plugins import Range as Range
    from palpate.core.plugins import check_ranges as check_ranges
    from palpate.core.plugins import class_by_name as class_by_name
    from palpate.core.plugins import ranges_of as ranges_of
    from palpate.core.poses import FACING_DOWN as FACING_DOWN
    from palpate.core.poses import IDENTITY_POSE as IDENTITY_POSE
    from palpate.core.poses import advanced_pose as advanced_pose
    from palpate.core.poses import compose_poses as compose_poses
    from palpate.core.poses import inverse_pose as inverse_pose
    from palpate.core.poses import pad_rotation as pad_rotation
    from palpate.core.poses import pose_of as pose_of
    from palpate.core.poses import rotation_matrix as rotation_matrix
    from palpate.core.poses import rotations_from_vectors as rotations_from_vectors
    from palpate.core.poses import split_pose as split_pose
    from palpate.core.poses import transform_points as transform_points
    from palpate.core.robot_time import ROBOT_PRESETS as ROBOT_PRESETS
    from palpate.core.robot_time import ROBOTS as ROBOTS
    from palpate.core.robot_time import MoveDurations as MoveDurations
    from palpate.core.robot_time import MoveGeometry as MoveGeometry
    from palpate.core.robot_time import RobotPreset as RobotPreset
    from palpate.core.robot_time import SlidingPreset as SlidingPreset
    from palpate.core.robot_time import contact_seconds as contact_seconds
    from palpate.core.robot_time import free_seconds as free_seconds
    from palpate.core.robot_time import longest_seconds as longest_seconds
    from palpate.core.robot_time import move_between as move_between
    from palpate.core.robot_time import move_durations as move_durations
    from palpate.core.steps import Steps as Steps
    from palpate.core.steps import no_steps as no_steps
else:
    __getattr__, __dir__ = lazy(__name__)
