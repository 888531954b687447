"""The effects that a scene lists: from a list with lines to parameters by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from palpate.core.touch.effect import Effect
from palpate.core.touch.effects.catalogue import NAMES, effect_type
from palpate.launch.convert import convert
from palpate.launch.located import InputError, KeyPath, Located
from palpate.launch.nearest import hint
from palpate.launch.own_modules import look_here


def with_effects(given: Located) -> Located:
    """The scene with its list of effects made into a map from name to parameters.

    An entry is a name, or a map from the name to the parameters. A user's own effect is named
    ``module:Class``; the module is looked for in the current folder as well.

    Raises
    ------
    InputError
        If the list is none, an effect is unknown or listed twice, or a parameter is unknown,
        of the wrong type, or out of its range.
    """
    listed = given.value.get("effects")
    if listed is None:  # the key is not there, or nothing stands behind it
        kept = {key: value for key, value in given.value.items() if key != "effects"}
        return Located(kept, given.source, given.places)
    if not isinstance(listed, list):
        raise given.error(("effects",), "effects must be a list: - gaussian_noise: {sigma: 1e-5}")
    effects: dict[str, Any] = {}
    kinds: dict[type, str] = {}
    places = dict(given.places)
    for i, entry in enumerate(listed):
        name, parameters = _entry(given, i, entry)
        if name in effects:
            raise given.error(("effects", i), f"effects lists {name!r} twice; list it once")
        where: KeyPath = ("effects", i, name) if isinstance(entry, Mapping) else ("effects", i)
        part = Located(parameters, given.place(where), _within(given, where))
        kind = type(described_effect(part, name))
        if kind in kinds:
            raise given.error(("effects", i), f"{name!r} and {kinds[kind]!r} are the same effect")
        kinds[kind] = name
        effects[name] = parameters
        places.update({("effects", name, *key): at for key, at in part.places.items()})
        places["effects", name] = part.source
    return Located({**given.value, "effects": effects}, given.source, places)


def described_effect(parameters: Located, name: str) -> Effect:
    """One effect.

    Raises
    ------
    InputError
        If there is none of this name, or a parameter cannot be used.
    """
    kind = _type(parameters, name)
    return convert(parameters, kind, f"effects.{name}")


def _entry(given: Located, i: int, entry: Any) -> tuple[str, dict[str, Any]]:
    if isinstance(entry, str):
        return entry, {}
    if isinstance(entry, Mapping) and len(entry) == 1:
        name, parameters = next(iter(entry.items()))
        if isinstance(name, str) and (parameters is None or isinstance(parameters, Mapping)):
            return name, dict(parameters or {})
    raise given.error(
        ("effects", i),
        f"effects[{i}] must be one effect and its parameters: - gaussian_noise: {{sigma: 1e-5}}",
    )


def _within(given: Located, where: KeyPath) -> dict[KeyPath, str]:
    size = len(where)
    return {key[size:]: at for key, at in given.places.items() if key[:size] == where}


def _type(parameters: Located, name: str) -> type[Effect]:
    look_here(name)
    try:
        return effect_type(name)
    except LookupError:
        place = f"{parameters.source}: " if parameters.source else ""
        raise InputError(f"{place}there is no effect {name!r}; {hint(name, NAMES)}") from None
    except ValueError as error:
        raise parameters.error((), str(error)) from None
