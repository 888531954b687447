"""Sizes of everything in the picture, in pixels, and of texts, estimated without a font."""

from __future__ import annotations

# Sizes of the letters: names of nodes, what is said beside, topics.
NAME, SMALL, TOPIC = 14.0, 10.5, 12.0
MARGIN = 16.0
LINE = 14.0  # From one line of a label to the next
UNDER = 4.0  # From a label to the line that it names
PORT = 13.0  # From one line that enters a box to the next
SLOT = 7.0  # From one upright line to the next
ROW = 11.0  # From one lane to the next
CLEAR = 16.0  # From the boxes to the first lane
BEND = 22.0  # Width in which a line to the next column may change its height
HEAD = 9.0  # Length of an arrow head
PAD = 9.0  # Between a box and what it holds
CARD = 4.0  # From one card of a stack to the next
CARDS = 3  # Most cards of a stack that are drawn
GAP = 26.0  # Between two boxes of a column
STUB = 16.0  # A loose line ends this far behind its label
FOOT = 26.0  # Height of what stands below the lanes
_NARROW, _WIDE = frozenset("fijlrt/.,:;|!' ()[]-_1"), frozenset("mwMW@%")
_EM_NARROW, _EM, _EM_WIDE = 0.35, 0.56, 0.86
_BOLD = 1.14


def text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Width of a text in a common sans-serif of this size, in the size's unit."""
    em = sum(
        _EM_NARROW if letter in _NARROW else _EM_WIDE if letter in _WIDE else _EM for letter in text
    )
    return size * em * (_BOLD if bold else 1.0)
