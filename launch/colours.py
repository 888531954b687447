"""The colour of each quantity, the same in every picture, page, film, view and plot.

A search found the colours that maximise the smallest difference between any two of them, in CIE
1976 L*a*b*, as people with normal sight, protanopia, deuteranopia and tritanopia see them (Machado,
Oliveira and Fernandes, 2009). Values on a surface have a scale instead: `palpate.tools.surfaces`.
"""

from __future__ import annotations

COLOURS = {
    "touch": "#f5ae0f",  # touched points, contacts of the hand
    "contour": "#0077be",
    "solid": "#c0d5f4",  # the rebuilt surface
    "truth": "#8c8c8c",  # the true surface
    "untouched": "#a4518d",  # surface and space that nothing touched or swept
    "finger": "#1bb867",  # the finger, its pad, its path, and the space that it swept
    "bound": "#e95a00",  # the stated error bound
    "error": "#1f2328",  # the true error
    "tolerance": "#b703a4",  # the requested error
}
ERROR_ON_DARK = "#e6edf3"  # the true error is drawn in the ink of its page


def rgb(quantity: str) -> tuple[int, int, int]:
    """Red, green and blue of a quantity, 0 to 255. Raises KeyError if it has no colour."""
    red, green, blue = bytes.fromhex(COLOURS[quantity][1:])
    return red, green, blue
