"""Effects as data: how scenes list them, and the pipeline that comes of the list.

Only the modules of listed effects are imported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import msgspec

from palpate.core import RobotPreset
from palpate.core.touch import SPRINGS, Effect, FaceModel, Fingertip, Pipeline, assemble
from palpate.core.touch.effects import effect_type, rank
from palpate.nodes.specs.sensors import SensorSpec, data_sheet, pad_of_spec

# Parameters of each listed effect by its name, or by ``module:Class``.
EffectSpecs = dict[str, dict[str, Any]]


def describe_effects(listed: Mapping[str, Mapping[str, Any]]) -> dict[str, Effect]:
    """The listed effects in the order in which they act, whatever the order of the list.

    Raises ValueError if there is no such effect, or a parameter is unknown or out of its range.
    """
    described = {name: _described(name, parameters) for name, parameters in listed.items()}
    ordered = sorted(described, key=lambda name: (described[name].phase, rank(name), name))
    return {name: described[name] for name in ordered}


def build_pipeline(
    sensor: SensorSpec,
    listed: Mapping[str, Mapping[str, Any]],
    robot: RobotPreset,
    finger: int = 1,
    seed: int = 0,
) -> Pipeline:
    """A finger with its effects.

    Raises ValueError if an effect cannot be had, or not with this sensor.
    """
    owner = Fingertip(pad_of_spec(sensor), data_sheet(sensor), robot, finger, seed)
    return assemble(owner, tuple(describe_effects(listed).values()))


def sensed_face(pipeline: Pipeline) -> FaceModel:
    """How the pad's face yields in what the array sends: forces show no skirt about a contact."""
    by_force = pipeline.finger.calibration.signal == "force"
    return SPRINGS if by_force else pipeline.face


def _described(name: str, parameters: Mapping[str, Any]) -> Effect:
    try:
        kind = effect_type(name)
    except LookupError as error:
        raise ValueError(str(error.args[0])) from None
    known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    for key in parameters:
        if key not in known:
            raise ValueError(f"effects.{name} has no parameter {key!r}; it has {known}")
    try:
        return msgspec.convert(parameters, kind)
    except msgspec.ValidationError as error:
        raise ValueError(f"effects.{name}: {error}") from None
