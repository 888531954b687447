"""A new effect of a user's own, from the template."""

from __future__ import annotations

import keyword
import re
from importlib.util import find_spec
from pathlib import Path

from palpate.core.touch.effects.catalogue import NAMES
from palpate.launch.located import InputError

_WORD = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
TEMPLATE = Path(__file__).parent / "templates" / "effect.py"


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
    if not _WORD.fullmatch(name) or keyword.iskeyword(name):
        raise InputError(f"{name!r} cannot name a module; take lower case letters, digits and _")
    if name in NAMES:
        raise InputError(f"{name!r} is an effect that palpate has; choose another name")
    path = folder / f"{name}.py"
    if not path.exists() and find_spec(name) is not None:
        raise InputError(f"{name!r} is a module that Python has; choose another name")
    cls = "".join(part.capitalize() for part in name.split("_"))
    text = TEMPLATE.read_text(encoding="utf-8")
    if keyword.iskeyword(cls) or re.search(rf"\b{cls}\b", text):
        raise InputError(f"the class {cls} of {name!r} has a meaning already; choose another name")
    text = text.replace("Template of an effect: mains hum", f"The effect {name}: mains hum")
    text = text.replace("template:Template", f"{name}:{cls}").replace("Template", cls)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path}: is there already; choose another name") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    return path, f"{name}:{cls}"
