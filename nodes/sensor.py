"""The fingertip's array and pad, as data: how scenes describe it and nodes remember it."""

from __future__ import annotations

import math
from typing import Annotated

from msgspec import Meta, Struct

from palpate.core.explore.aim import PRESS
from palpate.core.touch.pad import Pad
from palpate.messages.types import SensorInfo

LEAST_WIDTH, LARGEST_WIDTH = 12.0e-3, 20.0e-3
"""Widths of an array that the tracer can follow a contour with, m."""


class PadSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The elastic pad over the transducers."""

    thickness: Annotated[float, Meta(ge=0.0005, le=0.05, description="m")] = 0.003
    """Thickness, m."""
    radius: Annotated[float, Meta(gt=0, le=1, description="m")] | None = 0.015
    """Radius of the domed pad, m; null for a flat one."""
    sound_speed: Annotated[float, Meta(ge=100, le=5000, description="m/s")] = 1000.0
    """Speed of sound, m/s."""
    saturation: Annotated[float, Meta(gt=0.4, le=0.95)] = 0.8
    """Largest compression, as a share of the thickness."""


class SensorSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The fingertip's array."""

    rows: Annotated[int, Meta(ge=8, le=64)] = 16
    """Rows of taxels."""
    cols: Annotated[int, Meta(ge=8, le=64)] = 16
    """Columns of taxels."""
    pitch: Annotated[float, Meta(ge=0.0002, le=0.005, description="m")] = 0.001
    """Distance between neighbouring taxels, m."""
    pad: PadSpec = PadSpec()
    """The pad."""

    def __post_init__(self) -> None:
        widths = [self.pitch * (count - 1) for count in (self.rows, self.cols)]
        if min(widths) < LEAST_WIDTH or max(widths) > LARGEST_WIDTH:
            raise ValueError(
                f"rows, cols and pitch make an array of {1e3 * widths[0]:.3g} by "
                f"{1e3 * widths[1]:.3g} mm; the tracer's steps are made for 12 to 20 mm"
            )
        corner = 0.5 * math.hypot(*widths)
        if self.pad.radius is not None and self.pad.radius <= corner:
            raise ValueError(
                f"pad.radius is {self.pad.radius} m; a dome over this array needs more than "
                f"{corner:.3g} m, half its diagonal"
            )
        if self.pad.saturation * self.pad.thickness < PRESS:
            raise ValueError(
                f"pad.thickness is {self.pad.thickness} m; with pad.saturation "
                f"{self.pad.saturation} it must be at least {PRESS / self.pad.saturation:.3g} m, "
                f"to be pressed by {PRESS} m"
            )


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
