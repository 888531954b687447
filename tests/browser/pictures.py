"""What is seen in a picture of a page."""

import base64
import io
from typing import Any

import numpy as np
from PIL import Image


def picture_of(locator: Any) -> np.ndarray:
    """An element of a page as it is seen (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(locator.screenshot())).convert("RGB"))


def drawn_by(canvas: Any) -> np.ndarray:
    """What a canvas has drawn (height, width, 3), over white."""
    data = canvas.evaluate("one => one.toDataURL()").partition(",")[2]
    drawn = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGBA")
    ground = Image.new("RGBA", drawn.size, "white")
    return np.asarray(Image.alpha_composite(ground, drawn).convert("RGB"))


def colours_in(picture: np.ndarray) -> int:
    """Number of different colours: of a blank picture 1."""
    return len(np.unique(picture.reshape(-1, 3), axis=0))


def share_changed(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the pixels that look different."""
    return float((np.abs(before.astype(int) - after).max(axis=2) > 8).mean())
