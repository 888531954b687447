"""Words that all descriptions of objects share: lengths, seeds, poses."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.frames import rotation_matrix

Length = Annotated[float, Meta(gt=0, le=10, description="m")]
Coordinate = Annotated[float, Meta(ge=-10, le=10, description="m")]
Degrees = Annotated[float, Meta(ge=-360, le=360, description="degrees")]
Exponent = Annotated[float, Meta(ge=0.02, le=2, description="1")]
Seed = Annotated[int, Meta(ge=0, le=1 << 53)]
Place = Annotated[float, Meta(ge=-1000, le=1000, description="m")]
"""Farther off, a solid would lose the digits that its surface needs."""
Turn = Annotated[float, Meta(ge=-10, le=10)]
"""Of a quaternion; so that its length, which must be 1, can be worked out."""


class PoseSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the object's own frame stands in the world."""

    position: tuple[Place, Place, Place] = (0.0, 0.0, 0.0)
    """x, y, z, m."""
    rotation: tuple[Turn, Turn, Turn, Turn] = (0.0, 0.0, 0.0, 1.0)
    """Unit quaternion x, y, z, w."""

    def __post_init__(self) -> None:
        if not np.isfinite([*self.position, *self.rotation]).all():
            raise ValueError("position and rotation must be finite")
        rotation_matrix(np.array(self.rotation))


def pose_array(spec: PoseSpec) -> np.ndarray:
    """The pose as (7,) numbers."""
    return np.array([*spec.position, *spec.rotation])


def only_one(spec: Struct, what: str, names: tuple[str, ...]) -> str:
    """The one of a description's words that is given.

    Raises
    ------
    ValueError
        If it is none, or several.
    """
    given = [name for name in names if getattr(spec, name) is not None]
    if len(given) == 1:
        return given[0]
    raise ValueError(
        f"{what} is exactly one of {', '.join(names[:-1])} and {names[-1]}; "
        f"got {' and '.join(given) or 'none of them'}"
    )
