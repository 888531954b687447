"""The face of the pad is a tent: about a contact it slopes back to the free face."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pad import FaceModel, Pad
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Tenting(Ranged):
    """A membrane on a bed of springs: ``T lap(u) = k u`` outside the contact, ``u = c`` inside.

    About a straight edge ``u`` falls as ``exp(-x / l)`` with ``l = sqrt(T / k)``; at the border of
    the array it ends level. Five-point Laplacian at the pitch, solved exactly. The contact is where
    there is pressure: listed together with a half-space, that tells where and how hard the pad is
    touched, and this how its face falls beside it. An engineering value. At edges and corners the
    skirt reads as a rounding of half a millimetre, which would be traced as if it were the object
    by a decoder that does not know of it.
    """

    phase: ClassVar = Phase.PAD

    # The length ``l`` in which the skirt falls to 1/e: about the thickness of a tough cover.
    decay: Annotated[float, Range(1e-5, 20e-3, "m")] = 1e-3

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        membrane = _membrane(finger.pad, self.decay)

        def apply(touch: SimulatedTouch, state: None) -> None:
            contact = touch.pressure > 0.0
            rim = _rim(contact)
            if rim[0].size:
                skirt = _tent(*membrane, rim, touch.compression[rim])
                touch.compression = np.where(contact, touch.compression, np.maximum(skirt, 0.0))

        return Stage(apply, face=FaceModel("membrane", self.decay))


def _membrane(pad: Pad, decay: float) -> tuple[Floats, Floats, Floats]:
    """The membrane's modes along each side, and each one's height under its own unit load."""
    down, slow = _modes(pad.rows)
    across, slow_across = _modes(pad.cols)
    stiffness = (pad.pitch / decay) ** 2
    return down, across, 1.0 / (slow[:, None] + slow_across + stiffness)


def _modes(count: int) -> tuple[Floats, Floats]:
    """Orthonormal modes of a row of taxels in columns, and their second differences."""
    number, place = np.arange(count), np.arange(count)[:, None] + 0.5
    modes = np.cos(np.pi * number * place / count) * np.sqrt(2.0 / count)
    modes[:, 0] = np.sqrt(1.0 / count)
    return modes, 2.0 - 2.0 * np.cos(np.pi * number / count)


def _rim(contact: Bools) -> tuple[np.ndarray, ...]:
    """Rows and columns of the touched taxels beside a free one."""
    inner = contact.copy()
    inner[1:] &= contact[:-1]
    inner[:-1] &= contact[1:]
    inner[:, 1:] &= contact[:, :-1]
    inner[:, :-1] &= contact[:, 1:]
    return (contact & ~inner).nonzero()


def _tent(
    down: Floats, across: Floats, answers: Floats, rim: tuple[np.ndarray, ...], heights: Floats
) -> Floats:
    """Height of the membrane, (rows, cols), m, if it is held at the rim.

    Loads at the rim alone lift it there to its height: beyond the rim nothing else holds it, so
    this is the solution outside the contact (inside it means nothing). Their number is that of the
    rim, not of the free taxels.
    """
    modes = down[rim[0], :, None] * across[rim[1], None, :]
    flat = modes.reshape(heights.size, -1)
    loads = np.linalg.solve((modes * answers).reshape(flat.shape) @ flat.T, heights)
    amplitudes = answers * (loads @ flat).reshape(answers.shape)
    tent: Floats = down @ amplitudes @ across.T
    return tent
