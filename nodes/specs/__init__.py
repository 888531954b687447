"""What parameters of nodes and scenes describe.

Objects, sensors, effects, files of tactile frames. To be touched: ranges and defaults of the
structures, which check what they are given; a new solid is a structure and a `build_` function in
`solids`. Rests on `palpate.core.shapes` and `palpate.core.touch`, imported when a scene needs them.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.nodes.specs.frames import DRIVER_OUTPUTS, FRAMES_A_GOAL, MOST_FRAMES
    from palpate.nodes.specs.frames import FrameSequence, SensorParams, is_header
    from palpate.nodes.specs.frames import parse_row, read_frames, sensor_info, tactile_frame
    from palpate.nodes.specs.objects import EXTENT_LEVEL, ObjectSpec, PoseSpec, Seed
    from palpate.nodes.specs.objects import SuperquadricSpec, build_shape, encode_mesh
    from palpate.nodes.specs.objects import fitted_reach, object_extents
    from palpate.nodes.specs.primitives import Length
    from palpate.nodes.specs.sensors import CONTACT_ERROR, CalibrationSpec, EffectSpecs, PadSpec
    from palpate.nodes.specs.sensors import SensorSpec, build_pipeline, calibration_of_info
    from palpate.nodes.specs.sensors import describe_effects, info_of, pad_of_info, pad_of_spec
    from palpate.nodes.specs.sensors import resolution_of_info, sensed_face
else:
    __getattr__, __dir__ = lazy(__name__)
