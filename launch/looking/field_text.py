"""The fields of a message type with units and shapes, for people."""

from __future__ import annotations

from typing import Any

from palpate.messages.codec import schema


def field_lines(cls: type) -> list[str]:
    """One line for each field: name, what it holds, unit."""
    rows = [(name, *_described(rule)) for name, rule in schema(cls)["properties"].items()]
    wide = max(len(name) for name, _, _ in rows), max(len(what) for _, what, _ in rows)
    return [f"{name:<{wide[0]}}  {what:<{wide[1]}}  {unit}".rstrip() for name, what, unit in rows]


def _described(rule: dict[str, Any]) -> tuple[str, str]:
    """What a field holds, and its unit."""
    unit = str(rule.get("unit", ""))
    if "dtype" in rule:
        sides = " x ".join("any" if n is None else str(n) for n in rule["shape"])
        return f"{sides} {_DTYPES.get(rule['dtype'], rule['dtype'])}", unit
    if "enum" in rule:
        return " | ".join(map(str, rule["enum"])), unit
    if "anyOf" in rule:
        inner, inner_unit = _described(rule["anyOf"][0])
        return f"{inner} or null", inner_unit
    if rule["type"] == "array":
        inner, inner_unit = _described(rule["items"])
        return f"list of {inner}", inner_unit
    if rule["type"] == "object":
        return "table of number", unit
    return str(rule["type"]), unit


_DTYPES = {"<f8": "float64", "<i4": "int32", "|u1": "uint8", "|b1": "bool"}
