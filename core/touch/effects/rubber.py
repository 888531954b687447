"""Effects of the pad's rubber: elastic spreading, hardening, saturation, tenting and creep.

The pad by itself is a bed of springs; these effects change its pressures, or its face.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.plugins import Range, Ranged
from palpate.core.touch.pad import FaceModel, Pad, half_space_influence
from palpate.core.touch.pipeline import Fingertip, Phase, SimulatedTouch, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactSolverSettings:
    """Solution of the half-space's contact problem."""

    tolerance: float = 1e-7  # largest error of the face's depth, over the deepest indentation
    max_steps: int = 1000  # 30 are usual at 16 by 16 taxels, 100 at 32 by 32
    step_length: float = 1.9  # of a projected gradient step, times the kernel's norm; below 2


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfSpace(Ranged):
    """An elastic pad in place of a bed of springs: pressure here presses the face down there too.

    The pad as an elastic half-space, touched without friction.

    Find ``p >= 0`` with ``u = K p``, ``u = g`` where ``p > 0`` and ``u >= g`` elsewhere: the rigid
    surface indents the face by ``g``, and the free face around the contact is drawn down. ``K`` is
    the displacement under uniformly loaded squares (Love, 1929; Johnson, *Contact mechanics*, 1985,
    3.3). On a sphere this is Hertz's contact, whose radius is 0.71 of that of a bed of springs. It
    replaces the springs' pressures, so it matters for forces, which then no longer give the
    compression by (1.2), and for what is touched around a contact; the truth for a thin bonded pad
    lies between the two.
    """

    phase: ClassVar = Phase.PAD
    solver: ClassVar = ContactSolverSettings()

    # Young's modulus: that of a soft silicone, an engineering value.
    modulus: Annotated[float, Range(1e4, 1e8, "N/m2")] = 0.5e6
    # Poisson's ratio: rubber keeps its volume.
    poisson: Annotated[float, Range(0.0, 0.5, "1")] = 0.49

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger; it raises ArithmeticError if the solver does not converge."""
        size, solver = (finger.pad.rows, finger.pad.cols), self.solver
        kernel = half_space_influence(finger.pad)
        # No part of a matrix of positive numbers has a larger norm than its largest row sum.
        most = float(kernel.sum(axis=1).max())
        kernel /= most
        stiffness = math.pi * self.modulus / ((1.0 - self.poisson**2) * most)

        def apply(touch: SimulatedTouch, state: None) -> None:
            indentation = touch.indentation.ravel()
            near = np.flatnonzero(indentation > 0.0)  # no contact elsewhere
            if not near.size:
                return
            columns, deepest = kernel[near], float(indentation.max())
            pushed = _contact(columns[:, near], indentation[near] / deepest, solver)
            pressure = np.zeros(indentation.size)
            pressure[near] = (deepest * stiffness) * pushed
            face = np.maximum(deepest * (pushed @ columns), indentation)
            touch.pressure, touch.compression = pressure.reshape(size), face.reshape(size)

        return Stage(apply, face=FaceModel("half_space"))


def _contact(kernel: Floats, wanted: Floats, settings: ContactSolverSettings) -> Floats:
    """The x >= 0, (n,), with ``K x = wanted`` where x > 0 and ``K x >= wanted`` elsewhere.

    Conjugate gradients on the taxels with x > 0; a projected gradient step where one would become
    negative; a step that releases taxels with x = 0 where the face is too low there. Each step
    lowers the energy, so that it always converges: Dostal and Schoberl, *Minimizing quadratic
    functions subject to bound constraints*, 2005.
    """
    x: Floats = wanted / kernel.sum(axis=1)
    slope = kernel @ x - wanted
    free = direction = slope
    for _ in range(settings.max_steps):
        held = np.where(x > 0.0, 0.0, np.minimum(slope, 0.0))
        worst = max(float(np.abs(free).max()), -float(held.min()))
        if worst <= settings.tolerance:
            return x
        release = held @ held > np.minimum(x / settings.step_length, free) @ free
        if release:
            direction = held
        image = kernel @ direction
        bend = float(direction @ image)
        step = float(slope @ direction) / bend
        falls = direction > 0.0
        longest = float((x[falls] / direction[falls]).min(initial=np.inf))
        if step < longest:
            x, slope = np.maximum(x - step * direction, 0.0), slope - step * image
            free = np.where(x > 0.0, slope, 0.0)
            direction = free if release else free - (float(free @ image) / bend) * direction
        else:
            x, slope = np.maximum(x - longest * direction, 0.0), slope - longest * image
            projected = settings.step_length * np.where(x > 0.0, slope, 0.0)
            x = np.maximum(x - projected, 0.0)
            slope = kernel @ x - wanted
            free = direction = np.where(x > 0.0, slope, 0.0)
    raise ArithmeticError(
        f"half_space did not converge within {settings.max_steps} steps: the face is still off by "
        f"{worst:.3g} of the indentation; expected {settings.tolerance:g}"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Hardening(Ranged):
    """Rubber stiffens as it is squeezed.

    Pressure grows faster than (1.2) has it: ``p <- p (1 + h s^2 / (1 - s))``.

    ``s = c / D`` is the strain. The factor is 1 to first order and has its pole where the pad would
    have no thickness left. An engineering form: nearly linear below a strain of 0.3, as rubber is
    (Treloar, *The physics of rubber elasticity*, 1975), and steep above 0.7. Times of flight show
    it only through a compliant arm; forces show it directly.
    """

    phase: ClassVar = Phase.PAD
    max_strain: ClassVar = 0.98  # of the law, whose pole is at a strain of 1

    # The factor ``h``: 1 adds half the pressure at a strain of one half.
    strength: Annotated[float, Range(0.0, 10.0, "1")] = 1.0

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        strength, per_thickness = self.strength, 1.0 / finger.pad.thickness
        max_strain = self.max_strain

        def apply(touch: SimulatedTouch, state: None) -> None:
            strain = np.minimum(touch.compression * per_thickness, max_strain)
            touch.pressure = touch.pressure * (1.0 + strength * strain * strain / (1.0 - strain))

        return Stage(apply)


@dataclass(frozen=True, slots=True, kw_only=True)
class Saturation(Ranged):
    """A taxel that is pressed too hard reads no more than that.

    Compression and pressure are clipped, ``c <- min(c, share D)``, and the touch bottomed.

    The pad's own saturation, which every finger has, stops the move; this is the limit of what the
    array can follow, and may lie below it. The pressure falls in the same proportion as the
    compression. An engineering value. It matters where a press is deep: on corners, which lose
    their tips, and after a wrong guess of the surface.
    """

    phase: ClassVar = Phase.PAD

    # Largest compression that is measured, as a share of the thickness: rubber cannot be squeezed
    # to nothing.
    share: Annotated[float, Range(0.1, 0.95, "1")] = 0.8

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger."""
        limit = self.share * finger.pad.thickness

        def apply(touch: SimulatedTouch, state: None) -> None:
            compression = touch.compression
            if compression.max() <= limit:
                return
            touch.pressure = touch.pressure * (limit / np.maximum(compression, limit))
            touch.compression = np.minimum(compression, limit)
            if touch.outcome == "hit":
                touch.outcome = "bottomed"

        return Stage(apply)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tenting(Ranged):
    """The face of the pad is a tent: about a contact it slopes back to the free face.

    A membrane on a bed of springs: ``T lap(u) = k u`` outside the contact, ``u = c`` inside.

    About a straight edge ``u`` falls as ``exp(-x / l)`` with ``l = sqrt(T / k)``; at the border of
    the array it ends level. Five-point Laplacian at the pitch, solved exactly. The contact is where
    there is pressure: listed together with a half-space, that gives where and how hard the pad is
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
    """Rows and columns of touched taxels with a free neighbour."""
    inner = contact.copy()
    inner[1:] &= contact[:-1]
    inner[:-1] &= contact[1:]
    inner[:, 1:] &= contact[:, :-1]
    inner[:, :-1] &= contact[:, 1:]
    return (contact & ~inner).nonzero()


def _tent(
    down: Floats, across: Floats, answers: Floats, rim: tuple[np.ndarray, ...], heights: Floats
) -> Floats:
    """Height of the membrane, (rows, cols) [m], held at the rim.

    Loads at the rim taxels lift it there to the given heights. This is the solution outside the
    contact, where no other load acts; inside it has no meaning.
    """
    modes = down[rim[0], :, None] * across[rim[1], None, :]
    flat = modes.reshape(heights.size, -1)
    loads = np.linalg.solve((modes * answers).reshape(flat.shape) @ flat.T, heights)
    amplitudes = answers * (loads @ flat).reshape(answers.shape)
    tent: Floats = down @ amplitudes @ across.T
    return tent


@dataclass(frozen=True, slots=True, kw_only=True)
class Creep(Ranged):
    """Rubber gives way while it is held, and comes back slowly when it is let go.

    The standard linear solid: ``q' = -q / tau + c'``, and ``(1 - b) c + b q`` is measured.

    A share ``b`` of the answer relaxes while the pad is held, and is missing in the next touch if
    the pad had no time to recover. Solved in closed form for what a touch does: free, pressed at a
    constant rate, as long in every taxel as in the deepest, held, let go at once, and free on its
    way back. A free face reads nothing, never less. The pressure falls in the same proportion.
    Christensen, *Theory of viscoelasticity*, 1982; the values are engineering values. It matters
    after short rests and short dwells: a tenth of the depth is the largest error of a contour next
    to the arm's.
    """

    phase: ClassVar = Phase.PAD

    # The share ``b`` that relaxes: that of a filled silicone.
    share: Annotated[float, Range(0.0, 0.9, "1")] = 0.10
    tau: Annotated[float, Range(1e-3, 1e4, "s")] = 0.5  # Time constant of relaxation and recovery

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger; its state is q at the end of the touch, (rows, cols) [m]."""
        share, tau = self.share, self.tau

        def apply(touch: SimulatedTouch, state: Floats) -> Floats:
            compression = touch.compression
            until_frame = touch.rest + touch.loading + touch.dwell
            branch = state * math.exp(-until_frame / tau)
            branch += compression * _relaxed_share(touch.loading, touch.dwell, tau)
            answer = np.maximum((1.0 - share) * compression + share * branch, 0.0)
            ratio = np.divide(answer, compression, out=answer.copy(), where=compression > 0.0)
            touch.pressure, touch.compression = touch.pressure * ratio, answer
            after_frame = touch.time - touch.previous - until_frame
            return (branch - compression) * math.exp(-after_frame / tau)

        return Stage(apply, np.zeros((finger.pad.rows, finger.pad.cols)))


def _relaxed_share(loading: float, dwell: float, tau: float) -> float:
    """Ratio of q at the frame to the compression, of a pad at rest before."""
    ramp = loading / tau
    rise = -math.expm1(-ramp) / ramp if ramp > 0.0 else 1.0
    return rise * math.exp(-dwell / tau)
