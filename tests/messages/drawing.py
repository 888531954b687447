"""Messages of any type, every field of which is drawn at random within its schema."""

from typing import Any

import numpy as np

from palpate.messages import schema

Rule = dict[str, Any]


def drawn(cls: type, seed: int = 0) -> Any:
    """A message of a type."""
    rng = np.random.default_rng(seed)
    return cls(**{name: _value(rule, rng) for name, rule in schema(cls)["properties"].items()})


def _value(rule: Rule, rng: np.random.Generator) -> Any:
    if "anyOf" in rule:
        return _value(rule["anyOf"][0], rng) if rng.integers(4) else None
    if "enum" in rule:
        return rule["enum"][int(rng.integers(len(rule["enum"])))]
    if "dtype" in rule:
        shape = [int(rng.integers(1, 5)) if length is None else length for length in rule["shape"]]
        return (3.0 * rng.normal(size=shape)).astype(rule["dtype"])
    match rule["type"]:
        case "array":
            return tuple(_value(rule["items"], rng) for _ in range(int(rng.integers(4))))
        case "object":
            return {f"figure {i}": float(rng.normal()) for i in range(3)}
        case "number":
            return float(rng.normal())
        case "integer":
            return int(rng.integers(-(1 << 62), 1 << 62))
        case "boolean":
            return bool(rng.integers(2))
    return "a reason, µm"[: int(rng.integers(1, 13))]
