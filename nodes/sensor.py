"""The pad that a SensorInfo describes."""

from __future__ import annotations

from palpate.core.touch.pad import Pad
from palpate.messages.types import SensorInfo


def pad_of_info(info: SensorInfo) -> Pad:
    """Pad with the array and dome of a SensorInfo."""
    return Pad(
        rows=info.rows,
        cols=info.cols,
        pitch=info.pitch,
        thickness=info.thickness,
        dome=info.dome,
        saturation=info.saturation,
    )
