"""Solids from contours and contact points, and superquadrics from contacts: see docs/rebuild.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.rooms import lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.recovery import recover as recover
else:
    __getattr__, __dir__ = lazy(__name__)
