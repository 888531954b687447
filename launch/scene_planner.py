"""The planner that a scene names: that there is one, and that it takes these settings."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.core.explore.planners.catalogue import NAMES, planner_type
from palpate.core.explore.planners.choice import Planner
from palpate.launch.convert import convert
from palpate.launch.located import Located
from palpate.launch.nearest import hint
from palpate.launch.own_modules import look_here


def check_planner(given: Located) -> Planner | None:
    """Make the planner that a scene describes, ``explore: {planner: NAME, settings: {...}}``.

    A user's own is named ``module:Class``; the module is looked for in the current folder as well.

    Returns
    -------
    Planner or None
        None if the scene says nothing of one.

    Raises
    ------
    InputError
        If there is no such planner, or a setting is unknown, of the wrong type, or out of its
        range; with file and line.
    """
    explore = given.value.get("explore")
    if not isinstance(explore, Mapping) or not {"planner", "settings"} & set(explore):
        return None
    name, path = explore.get("planner", NAMES[0]), ("explore", "planner")
    if not isinstance(name, str):
        raise given.error(path, f"explore.planner is {name!r}; it must be a name, as {NAMES[0]}")
    look_here(name)
    try:
        kind = planner_type(name)
    except LookupError:
        raise given.error(path, f"there is no planner {name!r}; {hint(name, NAMES)}") from None
    except ValueError as error:
        raise given.error(path, str(error)) from None
    return convert(_settings(given, explore), kind, "explore.settings")


def _settings(given: Located, explore: Mapping[str, object]) -> Located:
    """What stands behind ``settings``; nothing is no settings."""
    path = ("explore", "settings")
    settings = explore.get("settings")
    if settings is None:
        return Located({}, given.place(path))
    if not isinstance(settings, Mapping):
        raise given.error(path, f"explore.settings is {settings!r}; it must be a map of numbers")
    return given.part(path)
