"""What parameters of nodes and scenes describe.

Objects, sensors, effects, files of tactile frames. To be touched: ranges and defaults of the
structures, which check what they are given; a new solid is a structure and a `build_` function in
`solids`. Rests on `palpate.core.shapes` and `palpate.core.touch`, imported when a scene needs them.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.nodes.specs.frames import DRIVER_OUTPUTS as DRIVER_OUTPUTS
    from palpate.nodes.specs.frames import FrameSequence as FrameSequence
    from palpate.nodes.specs.frames import SensorParams as SensorParams
    from palpate.nodes.specs.frames import is_header as is_header
    from palpate.nodes.specs.frames import parse_row as parse_row
    from palpate.nodes.specs.frames import read_frames as read_frames
    from palpate.nodes.specs.frames import sensor_info as sensor_info
    from palpate.nodes.specs.frames import tactile_frame as tactile_frame
    from palpate.nodes.specs.objects import Length as Length
    from palpate.nodes.specs.objects import ObjectSpec as ObjectSpec
    from palpate.nodes.specs.objects import PoseSpec as PoseSpec
    from palpate.nodes.specs.objects import Seed as Seed
    from palpate.nodes.specs.objects import SuperquadricSpec as SuperquadricSpec
    from palpate.nodes.specs.objects import build_shape as build_shape
    from palpate.nodes.specs.objects import encode_mesh as encode_mesh
    from palpate.nodes.specs.objects import fitted_reach as fitted_reach
    from palpate.nodes.specs.objects import object_extents as object_extents
    from palpate.nodes.specs.sensors import CONTACT_ERROR as CONTACT_ERROR
    from palpate.nodes.specs.sensors import CalibrationSpec as CalibrationSpec
    from palpate.nodes.specs.sensors import EffectSpecs as EffectSpecs
    from palpate.nodes.specs.sensors import PadSpec as PadSpec
    from palpate.nodes.specs.sensors import SensorSpec as SensorSpec
    from palpate.nodes.specs.sensors import build_pipeline as build_pipeline
    from palpate.nodes.specs.sensors import calibration_of_info as calibration_of_info
    from palpate.nodes.specs.sensors import describe_effects as describe_effects
    from palpate.nodes.specs.sensors import info_of as info_of
    from palpate.nodes.specs.sensors import pad_of_info as pad_of_info
    from palpate.nodes.specs.sensors import pad_of_spec as pad_of_spec
    from palpate.nodes.specs.sensors import resolution_of_info as resolution_of_info
    from palpate.nodes.specs.sensors import sensed_face as sensed_face
else:
    __getattr__, __dir__ = lazy(__name__)
