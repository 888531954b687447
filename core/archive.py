"""Archives: a tree of this package's values as named arrays or bytes, and back, bit for bit.

The tree's structure is one JSON text, which names the class of each node; each array is stored
beside it under its path, ``solid/evidence/noise``. Archives may be from untrusted sources: only
dataclasses and named tuples of `palpate.core` are built, by their own constructors, and no other
code runs. Classes are stored by name without module, so that archives stay readable if one moves.
Fields whose metadata have ``archived: False`` are not stored: only their defaults come back.
"""

from __future__ import annotations

import collections.abc
import dataclasses
import importlib
import io
import json
import math
import re
import types
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

FORMAT_VERSION = 1
FORM_KEY = "form"  # name of the text with the tree's structure
ROOT = "solid"  # path of the tree itself
NUMERIC_KINDS = "fiub"  # of arrays that can be stored: floats, integers and truth values
Arrays = dict[str, NDArray[np.generic]]
RENAMED: Mapping[str, str] = {"Solid": "LatticeSolid"}  # old names to current ones
# Types accepted for each kind of number.
NUMBER_TYPES: dict[type, tuple[type, ...]] = {
    float: (float, int, np.floating, np.integer),
    int: (int, np.integer),
    bool: (bool, np.bool_),
}


def tree_to_arrays(tree: object) -> Arrays:
    """Flat arrays that store a whole tree.

    `tree`: dataclasses and named tuples of `palpate.core`, tuples, lists, dicts with texts as keys,
    numbers, texts, None and numeric arrays, in any depth. Returns arrays by path, and the tree's
    structure under ``form``. Raises ValueError with the path of any other value, such as a
    function, and of a field that is not stored but differs from its default.
    """
    writer = _Writer()
    form = {"version": FORMAT_VERSION, "tree": writer.node(tree, ROOT)}
    text = json.dumps(form, allow_nan=False, separators=(",", ":"))
    return {FORM_KEY: np.array(text), **writer.arrays}


def tree_from_arrays(arrays: Mapping[str, NDArray[np.generic]]) -> Any:
    """The tree from the result of `tree_to_arrays`.

    `arrays`: may contain other arrays too. Raises ValueError if there is no structure or it is of
    another version, if an array is missing, if a class is unknown or has other fields now, or if a
    constructor fails.
    """
    if FORM_KEY not in arrays or arrays[FORM_KEY].dtype.kind != "U" or arrays[FORM_KEY].ndim:
        raise ValueError(f"an archive must have the text {FORM_KEY!r}, got none")
    try:
        form = json.loads(str(arrays[FORM_KEY]))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"the archive's form must be JSON: {error}") from None
    if not isinstance(form, dict) or form.keys() != {"version", "tree"}:
        raise ValueError("the archive's form must have a version and a tree")
    if form["version"] != FORMAT_VERSION:
        raise ValueError(
            f"the archive's version must be {FORMAT_VERSION}, got {form['version']!r:.20}"
        )
    try:
        return _Reader(arrays).value(form["tree"], ROOT)
    except RecursionError:
        raise ValueError("the archive's tree is nested too deeply to be read") from None


class _Writer:
    """Collects the arrays of a tree, each only once."""

    def __init__(self) -> None:
        self.arrays: Arrays = {}
        # The objects are kept alive, so that their ids stay unique.
        self._known: dict[int, tuple[str, object]] = {}

    def node(self, value: object, path: str) -> Any:
        """Node of a value in the structure."""
        if value is None or type(value) in (bool, int, str):
            return value
        if type(value) is float:
            return value if math.isfinite(value) else {"float": repr(value)}
        if id(value) in self._known:
            return {"same": self._known[id(value)][0]}
        self._known[id(value)] = (path, value)
        if isinstance(value, np.ndarray | np.generic):
            return self._array(value, path)
        if type(value) in (tuple, list):
            assert isinstance(value, tuple | list)
            items = [self.node(item, f"{path}/{i}") for i, item in enumerate(value)]
            return {"tuple" if type(value) is tuple else "list": items}
        if isinstance(value, Mapping):
            if not all(type(key) is str for key in value):
                raise ValueError(f"{path} must have texts as keys, got {list(value)!r:.60}")
            return {"dict": {key: self.node(item, f"{path}/{key}") for key, item in value.items()}}
        name = class_name(type(value))
        if name is None:
            raise ValueError(f"{path} cannot be stored: it is a {type(value).__qualname__}")
        for field, default in unstored_defaults(type(value)).items():
            if getattr(value, field) != default:
                raise ValueError(f"{path}/{field} cannot be stored: it is not the default")
        fields = field_names(type(value))
        parts = {field: self.node(getattr(value, field), f"{path}/{field}") for field in fields}
        return {"class": name, "fields": parts}

    def _array(self, value: np.ndarray[Any, Any] | np.generic, path: str) -> Any:
        """Node of an array, stored in its memory order, on which rounding may depend."""
        if value.dtype.kind not in NUMERIC_KINDS:
            raise ValueError(f"{path} must be an array of numbers, got {value.dtype}")
        kept = np.asarray(value)
        order = sorted(range(kept.ndim), key=lambda axis: (-abs(kept.strides[axis]), axis))
        shape = [kept.shape[axis] for axis in order]
        self.arrays[path] = np.ascontiguousarray(kept.transpose(order)).reshape(shape)
        if isinstance(value, np.generic):
            return {"scalar": path}
        plain = order == list(range(kept.ndim))
        return {"array": path} if plain else {"array": path, "order": order}


class _Reader:
    """Builds a tree from its structure."""

    def __init__(self, arrays: Mapping[str, NDArray[np.generic]]):
        self._arrays = arrays
        self._built: dict[str, object] = {}

    def value(self, node: Any, path: str) -> Any:
        """Value of a node."""
        if node is None or isinstance(node, bool | int | float | str):
            return node
        if not isinstance(node, dict) or not node:
            raise ValueError(f"{path} of the archive has no meaning: {node!r:.60}")
        self._built[path] = built = self._build(node, path)
        return built

    def _build(self, node: dict[str, Any], path: str) -> object:
        match node:
            case {"same": str(earlier)} if earlier in self._built:
                return self._built[earlier]
            case {"float": "inf" | "-inf" | "nan" as text}:
                return float(text)
            case {"scalar": str(name)}:
                return self._array(name, path).reshape(())[()]
            case {"array": str(name), **rest}:
                return self._ordered(self._array(name, path), rest.get("order"), path)
            case {"tuple": list(items)}:
                return tuple(self.value(item, f"{path}/{i}") for i, item in enumerate(items))
            case {"list": list(items)}:
                return [self.value(item, f"{path}/{i}") for i, item in enumerate(items)]
            case {"dict": dict(items)}:
                return {key: self.value(item, f"{path}/{key}") for key, item in items.items()}
            case {"class": str(name), "fields": dict(fields)}:
                return self._instance(name, fields, path)
        raise ValueError(f"{path} of the archive has no meaning: {node!r:.60}")

    def _array(self, name: str, path: str) -> NDArray[np.generic]:
        if name not in self._arrays:
            raise ValueError(f"{path} of the archive is missing: there is no array {name!r:.80}")
        array = self._arrays[name]
        if array.dtype.kind not in NUMERIC_KINDS:
            raise ValueError(f"{path} of the archive must be numbers, got {array.dtype}")
        return array

    def _ordered(self, array: NDArray[np.generic], order: Any, path: str) -> NDArray[np.generic]:
        if order is None:
            return array
        if not isinstance(order, list) or sorted(order, key=repr) != list(range(array.ndim)):
            raise ValueError(f"{path} of the archive must have its axes in an order, got {order}")
        return array.transpose(np.argsort(order))

    def _instance(self, name: str, fields: dict[str, Any], path: str) -> object:
        kind = class_named(name)
        expected = field_names(kind)
        if set(fields) != set(expected):
            odd = ", ".join(sorted(set(fields) ^ set(expected)))
            raise ValueError(f"{path} of the archive is a {name} of another version: {odd}")
        parts = {field: self.value(node, f"{path}/{field}") for field, node in fields.items()}
        hints = declared_types(kind)
        for field, part in parts.items():
            if not fits_type(part, hints.get(field, Any)):
                raise ValueError(f"{path}/{field} of the archive cannot be a {type(part).__name__}")
        try:
            return kind(**parts)
        except (TypeError, AttributeError, IndexError, ArithmeticError) as error:
            raise ValueError(f"{path} of the archive is no {name}: {error}") from None


def class_named(name: str) -> type:
    """Class with a name; ValueError if there is none, or archives cannot store it."""
    kinds: list[type] = [
        kind
        for module in _modules().get(RENAMED.get(name, name), ())
        if _is_record(kind := getattr(importlib.import_module(module), RENAMED.get(name, name)))
    ]
    if len(kinds) != 1:
        raise ValueError(f"archives hold no class {name!r:.80}")
    return kinds[0]


def class_name(kind: type) -> str | None:
    """Name of a class in archives; None if they cannot store it."""
    name = kind.__qualname__
    is_stored = kind.__module__ in _modules().get(name, ()) and _is_record(kind)
    return name if is_stored and class_named(name) is kind else None


@cache
def _modules() -> dict[str, list[str]]:
    """Modules of core by the names of their classes, read from the sources."""
    root, modules = Path(__file__).parent, dict[str, list[str]]()
    for path in sorted(root.rglob("*.py")):
        module = ".".join(("palpate.core", *path.relative_to(root).with_suffix("").parts))
        for name in re.findall(r"^class (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE):
            modules.setdefault(name, []).append(module)
    return modules


def _is_record(kind: type) -> bool:
    return dataclasses.is_dataclass(kind) or (issubclass(kind, tuple) and hasattr(kind, "_fields"))


def field_names(kind: type) -> tuple[str, ...]:
    """Fields of the constructor that are stored; all others are computed, or have a default."""
    if dataclasses.is_dataclass(kind):
        names = [field.name for field in dataclasses.fields(kind) if field.init]
        unstored = unstored_defaults(kind)
        return tuple(name for name in names if name not in unstored)
    fields: tuple[str, ...] = kind._fields  # type: ignore[attr-defined]
    return fields


def unstored_defaults(kind: type) -> dict[str, Any]:
    """Defaults of the fields that archives leave out, by name: how things are done, not results."""
    fields = dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ()
    unstored = (field for field in fields if not field.metadata.get("archived", True))
    return {field.name: field.default for field in unstored}


@cache
def declared_types(kind: type) -> dict[str, Any]:
    """Declared types of a class's fields; empty where they cannot be resolved."""
    try:
        return get_type_hints(kind)
    except NameError:  # a name that is imported for checkers alone
        return {}


def tree_to_bytes(tree: object) -> NDArray[np.uint8]:
    """Bytes (n,) of a tree, equal for equal trees; errors as of `tree_to_arrays`."""
    return arrays_to_bytes(tree_to_arrays(tree))


def arrays_to_bytes(arrays: Mapping[str, NDArray[np.generic]]) -> NDArray[np.uint8]:
    """Bytes (n,) of a tree's arrays, for `arrays_from_bytes`."""
    data = io.BytesIO()
    np.savez(data, allow_pickle=False, **arrays)
    return np.frombuffer(data.getvalue(), np.uint8)


def arrays_from_bytes(data: NDArray[np.uint8]) -> Arrays:
    """Arrays for `tree_from_arrays`, from bytes of `tree_to_bytes`; ValueError for other bytes."""
    try:
        with np.load(io.BytesIO(data.tobytes()), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (OSError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise ValueError(f"bytes must be a packed tree, got {data.size}: {error}") from None


def fits_type(value: object, hint: Any) -> bool:
    """Whether a value has the type of a declaration; True for declarations of other kinds."""
    origin, args = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if origin in (Union, types.UnionType):
        return any(fits_type(value, arg) for arg in args)
    if origin is Literal:
        return value in args
    if origin is tuple:
        if not isinstance(value, tuple):
            return False
        hints = args[:1] * len(value) if args[1:] == (...,) else args
        return len(value) == len(hints) and all(map(fits_type, value, hints))
    if origin in (list, collections.abc.Sequence):
        return isinstance(value, list | tuple) and all(fits_type(item, args[0]) for item in value)
    if origin in (dict, collections.abc.Mapping):
        return isinstance(value, dict) and all(fits_type(item, args[1]) for item in value.values())
    if origin is np.ndarray:
        return isinstance(value, np.ndarray)
    if hint is None or hint is type(None):
        return value is None
    if isinstance(hint, type) and getattr(hint, "_is_protocol", False):
        return _is_record(type(value))
    if isinstance(hint, type):
        return isinstance(value, NUMBER_TYPES.get(hint, (hint,)))
    return value is not None
