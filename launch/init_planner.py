"""A new planner of a user's own, from the template, with what must hold of it."""

from __future__ import annotations

from pathlib import Path

from palpate.core.explore.planners.catalogue import NAMES
from palpate.launch.init_module import TEMPLATES, class_of, write_new


def init_planner(name: str, folder: Path) -> tuple[Path, Path, str]:
    """Write the module of a new planner, and its test.

    Parameters
    ----------
    name : str
        The module's name: lower case, with underscores.
    folder : Path
        Where to put them.

    Returns
    -------
    path : Path
        The new module.
    test : Path
        Its test.
    named : str
        How a scene names the planner.

    Raises
    ------
    InputError
        If the name cannot be a module's, or is taken, or a file cannot be written.
    """
    path, test = folder / f"{name}.py", folder / f"test_{name}.py"
    rule, check = (
        (TEMPLATES / file).read_text(encoding="utf-8")
        for file in ("planner.py", "planner_check.py")
    )
    cls = class_of(name, "a planner", NAMES, path, rule, check)
    named = f"{name}:{cls}"
    rule = rule.replace("Template of a planner: first", f"The planner {name}: first")
    rule = rule.replace("template:Template", named).replace("Template", cls)
    check = check.replace("palpate.launch.templates.planner", name).replace("Template", cls)
    write_new({path: rule, test: check})
    return path, test, named
