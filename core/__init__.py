"""What palpate knows: arrays in, arrays out; no clock, file, socket, log or global state.

These chapters serve all its rooms: array types and their checks, poses, batched least squares,
archives of values, plug-ins and their parameters, what moves cost a robot, and steps of long work.
Only the presets of `robot_time` are assumptions, to be replaced. They rest on numpy alone.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.archive import FORM_KEY, arrays_from_bytes, tree_from_arrays, tree_to_arrays
    from palpate.core.archive import tree_to_bytes
    from palpate.core.arrays import Bools, Floats, Ints
    from palpate.core.plugins import LENGTHS, TIMES, UNITS, Range, check_ranges, class_by_name
    from palpate.core.plugins import code_place, in_base_unit, in_base_units, ranges_of
    from palpate.core.plugins import told_error
    from palpate.core.poses import FACING_DOWN, IDENTITY_POSE, advanced_pose, compose_poses
    from palpate.core.poses import inverse_pose, pad_rotation, pose_of, rotation_matrix
    from palpate.core.poses import rotations_from_vectors, split_pose, transform_points
    from palpate.core.robot_time import ROBOTS, ROBOT_PRESETS, MoveDurations, MoveGeometry
    from palpate.core.robot_time import RobotPreset, SlidingPreset, contact_seconds, free_seconds
    from palpate.core.robot_time import longest_seconds, move_between, move_durations
    from palpate.core.steps import Steps, no_steps
else:
    __getattr__, __dir__ = lazy(__name__)
