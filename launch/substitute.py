"""``$(name)`` in a launch file: the one way in which a value gets into it from outside.

A text that is nothing but one reference becomes the value itself, whatever its type; within a
longer text the value is inserted as text. ``$(scene.object)`` reaches into a map.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from palpate.launch.located import KeyPath, Located
from palpate.launch.nearest import hint

_REFERENCE = re.compile(r"\$\(([^()]*)\)")


def substitute(given: Located, known: Mapping[str, Located]) -> Located:
    """The document with every reference replaced.

    Parameters
    ----------
    given : Located
        Plain values.
    known : map
        Name to value; the places of a value that is inserted whole are kept.

    Raises
    ------
    InputError
        If a name is not known, or a map or list stands within a longer text.
    """
    places = dict(given.places)
    return Located(_replaced(given, given.value, (), known, places), given.source, places)


def _replaced(
    given: Located,
    value: Any,
    path: KeyPath,
    known: Mapping[str, Located],
    places: dict[KeyPath, str],
) -> Any:
    if isinstance(value, dict):
        return {k: _replaced(given, v, (*path, k), known, places) for k, v in value.items()}
    if isinstance(value, list):
        return [_replaced(given, v, (*path, i), known, places) for i, v in enumerate(value)]
    if not isinstance(value, str):
        return value
    whole = _REFERENCE.fullmatch(value)
    if whole:
        found = _look_up(given, whole[1], path, known)
        places.update({(*path, *key): at for key, at in found.places.items()})
        if () not in found.places and found.source:
            places[path] = found.source
        return found.value
    return _REFERENCE.sub(lambda match: _as_text(given, match[1], path, known), value)


def _look_up(given: Located, name: str, path: KeyPath, known: Mapping[str, Located]) -> Located:
    first, *rest = name.split(".")
    if first not in known:
        raise given.error(path, f"$({name}) is not known; {hint(first, known)}")
    found = known[first]
    for key in rest:
        if not isinstance(found.value, Mapping) or key not in found.value:
            keys = found.value if isinstance(found.value, Mapping) else ()
            raise given.error(path, f"$({name}): there is no {key!r}; {hint(key, keys)}")
        found = found.part((key,))
    return found


def _as_text(given: Located, name: str, path: KeyPath, known: Mapping[str, Located]) -> str:
    value = _look_up(given, name, path, known).value
    if isinstance(value, (dict, list, tuple, bytes)):
        raise given.error(path, f"$({name}) is more than a word; it must stand alone")
    return str(value)
