"""The form of a box: its size, and where lines enter and leave it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from palpate.launch.drawing import sizes
from palpate.launch.drawing.sketch import Box
from palpate.launch.drawing.strands import Strand
from palpate.launch.drawing.text_width import text_width

_LEAST = 40.0


@dataclass(frozen=True, slots=True)
class Form:
    """A box that stands nowhere yet."""

    width: float
    height: float
    back: float
    """How far the cards behind stand out, up and to the right."""
    labels: float
    """Width of the widest label at its right side."""
    right: Mapping[Strand, float]
    """Heights below its top at which lines leave."""
    left: Mapping[Strand, float]
    """Heights below its top at which lines enter."""


def form_of(box: Box, leaving: Sequence[Strand], entering: Sequence[Strand]) -> Form:
    """Form of a box with its lines, both from top to bottom."""
    slots = [len(one.wire.labels) * sizes.LINE + sizes.UNDER for one in leaving]
    tall = max(sum(slots), sizes.PORT * len(entering)) + 2.0 * sizes.PAD
    height = max(tall, _LEAST + (sizes.SMALL + sizes.UNDER if small_text(box) else 0.0))
    right, y = {}, (height - sum(slots)) / 2.0
    for strand, slot in zip(leaving, slots, strict=True):
        y += slot
        right[strand] = y
    first = (height - sizes.PORT * (len(entering) - 1)) / 2.0
    texts = [text for one in leaving for text in one.wire.labels]
    return Form(
        width=2.0 * sizes.PAD + max(_name_width(box), text_width(small_text(box), sizes.SMALL)),
        height=height,
        back=sizes.CARD * (min(box.count, sizes.CARDS) - 1),
        labels=max((text_width(text, sizes.TOPIC) for text in texts), default=0.0),
        right=right,
        left={strand: first + i * sizes.PORT for i, strand in enumerate(entering)},
    )


def name_text(box: Box) -> str:
    """What stands large in a box."""
    return box.text if box.count == 1 else f"{box.text} \N{MULTIPLICATION SIGN} {box.count}"


def small_text(box: Box) -> str:
    """What stands small in a box, under its name; empty if nothing does."""
    return box.kind


def _name_width(box: Box) -> float:
    return text_width(name_text(box), sizes.NAME, bold=True)
