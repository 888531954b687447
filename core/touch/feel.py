"""From one image of compression to the patch of surface that pressed it: the whole of one touch."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.touch.clean import clean
from palpate.core.touch.curvature import Patch, feel_patch
from palpate.core.touch.pad import Pad

CONTACT = 50e-6
"""Least compression that counts as touched, m, as for the filter."""
LEAST = 4
"""Rows and columns of an array."""
ALONG_ROWS: Floats = np.array([1.0, 0.0, 0.0])
"""The pad's x axis, along which `across` is told."""


def feel(
    compression: Floats,
    pitch: float,
    *,
    radius: float | None = None,
    noise: float = 0.0,
    contact: float = CONTACT,
) -> Patch:
    """Normal, curvatures and verdict of one touch, from any array over an elastic pad.

    Parameters
    ----------
    compression : (rows, cols) array
        Compression of the pad under each taxel, m, at least 4 by 4. Row i lies at
        ``y = (i - (rows - 1) / 2) * pitch``.
    pitch : float
        Distance between neighbouring taxels, m.
    radius : float, optional
        Radius of a domed pad, m; None for a flat one.
    noise : float
        Standard deviation of one taxel, m, as far as known: errors are for no less.
    contact : float
        Least compression that counts as touched, m.

    Returns
    -------
    Patch
        In the pad's frame: x along the columns, y along the rows, z into the object.

    Raises
    ------
    ValueError
        If the image is no finite array of at least 4 by 4, or a length is not positive.
    """
    image = finite_array("compression", compression, (None, None))
    if min(image.shape) < LEAST:
        raise ValueError(f"compression must be at least {LEAST} by {LEAST}, got {image.shape}")
    if not 0.0 <= noise < np.inf:
        raise ValueError(f"noise must not be negative, got {noise} m")
    positive("contact", contact, "m")
    # Its thickness, and where it saturates, matter to who presses it, not to what it then says.
    pad = Pad(
        rows=image.shape[0],
        cols=image.shape[1],
        pitch=positive("pitch", pitch, "m"),
        thickness=pitch,
        dome=0.0 if radius is None else 1.0 / positive("radius", radius, "m"),
        saturation=1.0,
    )
    cleaned = clean(pad, image, noise, contact, "auto")
    surface = np.where(cleaned.touched, -(cleaned.compression + pad.sag()), 0.0)
    return feel_patch(pad, surface, cleaned.touched, ALONG_ROWS, noise)
