from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from msgspec import Struct

from palpate.core.poses import IDENTITY_POSE
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.files.yaml_file import parse_yaml
from palpate.messages.types.model import Score, ShapeModel
from palpate.messages.types.motion import Contour
from palpate.nodes.runtime.node import Node

MakeNode = Callable[..., str]
Write = Callable[[str, str], Path]


class NoParams(Struct, frozen=True, kw_only=True):
    pass


def _quiet(params: Any, state: Any, message: Any) -> tuple[Any, list[Any]]:
    return state, []


@pytest.fixture
def make_node(monkeypatch: pytest.MonkeyPatch) -> MakeNode:
    """Puts a node that does nothing where it can be imported; gives the module's name."""

    def make(
        module: str,
        hears: Mapping[str, type] | None = None,
        says: Mapping[str, type] | None = None,
        params: type = NoParams,
        many: tuple[str, ...] = (),
        shared: tuple[str, ...] = (),
        value: object = None,
    ) -> str:
        node = Node(
            params=params,
            start=lambda _: (None, []),
            inputs={topic: (said, _quiet) for topic, said in (hears or {}).items()},
            outputs=says or {},
            many=many,
            shared=shared,
        )
        made = ModuleType(module)
        made.NODE = node if value is None else value  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module, made)
        return module

    return make


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder in which palpate is started; its modules are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    yield tmp_path
    for name, module in [*sys.modules.items()]:
        if str(getattr(module, "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a text into a file of the test's own folder."""

    def do(name: str, text: str) -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return do


@pytest.fixture
def typed() -> Callable[[str], SourceMapped]:
    """A YAML text as a document with places."""
    return lambda text: parse_yaml(text, "f.yaml")


@pytest.fixture
def tetrahedron() -> ShapeModel:
    """The smallest closed solid."""
    return ShapeModel(
        number=1,
        contours=(0, 1),
        probes=(),
        dropped=(2,),
        dropped_reasons=("too short",),
        control=np.zeros((4, 4, 4, 3)),
        undeformed=np.zeros((4, 4, 4, 3)),
        knots_columns=np.zeros(8),
        knots_rows=np.zeros(8),
        knots_layers=np.zeros(8),
        vertices=np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.02, 0], [0, 0, 0.03]]),
        faces=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32),
        frame=IDENTITY_POSE,
        deviation=0.0,
        uncertainty_height=np.array([0.0]),
        uncertainty=np.array([0.001]),
        health={"condition": 3.5, "fallbacks": 0.0},
        touches=40,
        robot_time=20.0,
        final=True,
    )


@pytest.fixture
def contour() -> Contour:
    """A contour of one point."""
    return Contour(
        id=0,
        finger=1,
        frame=np.array([0.0, 0, 0, 0, 0, 0, 1]),
        height=0.01,
        points=np.zeros((1, 3)),
        normals=np.array([[1.0, 0, 0]]),
        curvature=np.zeros(1),
        status="closed",
        gap_starts=np.zeros((0, 3)),
        gap_ends=np.zeros((0, 3)),
        gap_reasons=(),
        contact_low=np.zeros(0),
        contact_high=np.zeros(0),
        touches=30,
        robot_time=15.0,
    )


@pytest.fixture
def score() -> Score:
    """A score of the tetrahedron."""
    return Score(
        number=1,
        contours=2,
        touches=40,
        robot_time=20.0,
        chamfer=0.0003,
        rms=0.0004,
        p95=0.0008,
        hausdorff=0.002,
        normal=3.0,
        volume_error=-0.01,
        sampling_floor=0.00005,
        size=0.03,
        watertight=True,
        genus=0,
        final=True,
    )
