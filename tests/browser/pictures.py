"""Pictures of pages, and their differences."""

import base64
import io
from typing import Any

import numpy as np
from PIL import Image


def picture_of(locator: Any) -> np.ndarray:
    """Screenshot (height, width, 3) of an element of a page."""
    return np.asarray(Image.open(io.BytesIO(locator.screenshot())).convert("RGB"))


def drawn_by(canvas: Any) -> np.ndarray:
    """Drawing (height, width, 3) of a canvas, over white."""
    data = canvas.evaluate("canvas => canvas.toDataURL()").partition(",")[2]
    drawn = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGBA")
    ground = Image.new("RGBA", drawn.size, "white")
    return np.asarray(Image.alpha_composite(ground, drawn).convert("RGB"))


def colours_in(picture: np.ndarray) -> int:
    """Number of different colours: 1 for a blank picture."""
    return len(np.unique(picture.reshape(-1, 3), axis=0))


def share_changed(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the pixels that look different."""
    return float((np.abs(before.astype(int) - after).max(axis=2) > 8).mean())


def is_changed(before: np.ndarray, after: np.ndarray, min_share: float = 0.003) -> bool:
    """Whether a picture has visibly changed."""
    return share_changed(before, after) > min_share


def is_same(before: np.ndarray, after: np.ndarray, max_share: float = 0.0003) -> bool:
    """Whether two pictures look the same."""
    return share_changed(before, after) < max_share
