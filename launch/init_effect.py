"""A new effect of a user's own, from the template."""

from __future__ import annotations

from pathlib import Path

from palpate.core.touch.effects.catalogue import NAMES
from palpate.launch.init_module import TEMPLATES, class_of, write_new


def init_effect(name: str, folder: Path) -> tuple[Path, str]:
    """Write the module of a new effect.

    Parameters
    ----------
    name : str
        The module's name: lower case, with underscores.
    folder : Path
        Where to put it.

    Returns
    -------
    path : Path
        The new file.
    listed : str
        How a scene lists the effect.

    Raises
    ------
    InputError
        If the name cannot be a module's, or is taken, or the file cannot be written.
    """
    path = folder / f"{name}.py"
    text = (TEMPLATES / "effect.py").read_text(encoding="utf-8")
    cls = class_of(name, "an effect", NAMES, path, text)
    text = text.replace("Template of an effect: mains hum", f"The effect {name}: mains hum")
    text = text.replace("template:Template", f"{name}:{cls}").replace("Template", cls)
    write_new({path: text})
    return path, f"{name}:{cls}"
