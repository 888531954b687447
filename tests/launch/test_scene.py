from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.launch.located import InputError
from palpate.launch.scene import SHIPPED, find_scene, load_scene, shipped_scenes

Write = Callable[[str, str], Path]

BALL = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_shipped_scene_loads_and_stands_on_the_ground(name: str) -> None:
    scene = load_scene(name)

    assert scene.name == name
    assert 0.05 <= max(scene.size) <= 0.15


def test_fourteen_scenes_are_shipped() -> None:
    assert shipped_scenes() == (
        "bottle",
        "box",
        "cylinder",
        "dented",
        "egg",
        "from_mesh",
        "gem",
        "hyperquadric",
        "notched",
        "oblique",
        "sphere",
        "twisted",
        "vase",
        "worn_sensor",
    )


def test_a_scene_fills_in_its_defaults(write: Write) -> None:
    scene = load_scene(write("ball.yaml", BALL))

    assert scene.name == "ball"
    assert scene.spec.sensor.rows == 16
    assert scene.located.value["seed"] == 0
    assert scene.located.place(("object", "superquadric", "size")).endswith("ball.yaml:2")
    assert scene.size == pytest.approx((0.08, 0.08, 0.08))


def test_a_mesh_is_read_into_the_scene_in_metres() -> None:
    mesh = load_scene("from_mesh").spec.object.mesh

    assert mesh is not None
    vertices = np.frombuffer(mesh.vertices, "<f8").reshape(-1, 3)
    assert vertices[:, 2].min() == 0.0
    assert vertices[:, 2].max() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "bad.yaml: is empty"),
        ("a: [", "bad.yaml:1: is not YAML"),
        ("seed: 3", "bad.yaml:1: the document lacks the key 'object'"),
        (BALL + "sede: 3", "bad.yaml:3: unknown key 'sede'; did you mean 'seed'?"),
        (
            "object:\n  superquadric:\n    sizes: [1, 1, 1]",
            "bad.yaml:3: unknown key 'sizes' in object.superquadric; did you mean 'size'?",
        ),
        (
            "object:\n  superquadric:\n    size: [0.04, -0.03, 0.05]\n    exponents: [1, 1]",
            "bad.yaml:3: object.superquadric.size[1] is -0.03; expected number > 0.0",
        ),
        (
            "object:\n  superquadric: {size: [0.04, .inf, 0.05], exponents: [1, 1]}",
            "bad.yaml:2: object.superquadric.size[1] is inf; a number must be finite",
        ),
        (
            "object: {}",
            "bad.yaml:1: object: an object is exactly one of superquadric, hyperquadric",
        ),
        (BALL + "seed: -1", "bad.yaml:3: seed is -1; expected whole number >= 0"),
        (BALL + "world: {reach: 0.05}", "but the finger reaches 0.05 m; enlarge world.reach"),
        (
            "object:\n  mesh: {file: none.ply, unit: mm}",
            "none.ply: the mesh cannot be read: No such file",
        ),
        ("object:\n  mesh: {file: x.ply}", "bad.yaml:2: object.mesh lacks the key 'unit'"),
        (
            "object:\n  mesh: {file: x.ply, unit: inch}",
            "bad.yaml:2: object.mesh.unit is 'inch'; expected one of cm, m, mm",
        ),
        (
            "object:\n  mesh: {file: ../x.ply, unit: mm}",
            "bad.yaml:2: object.mesh.file is '../x.ply'; it must lie in the scene's own folder",
        ),
        ("object:\n  mesh: {file: /etc/x.ply, unit: mm}", "must lie in the scene's own folder"),
        ("object: 3", "bad.yaml:1: object is 3; expected map"),
        (
            "object:\n  hyperquadric:\n    terms:\n      - {plane: [30, 0, 0, 0], exponent: 4}\n"
            "      - {plane: [0, 30, 0, 0], exponent: 4}\n      - {plan: [0, 0, 1, 0]}",
            "bad.yaml:6: unknown key 'plan' in object.hyperquadric.terms[2]; did you mean 'plane'?",
        ),
        (
            "object:\n  generalised_cylinder:\n    section: {size: [0.03, 0.03]}\n"
            "    sweep: [[0.0, 1.0], [0.0, 0.5]]",
            "bad.yaml:2: object.generalised_cylinder: heights must increase, by 1e-09 m or more",
        ),
        (
            "object:\n  polyhedron:\n    vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
            "    faces: [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 3, 2]]",
            "bad.yaml:4: object.polyhedron: faces[1] and faces[3] both walk the edge from vertex 1",
        ),
        (
            "object:\n  boolean:\n    union:\n"
            "      - superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"
            "      - half_space: {normal: [0, 0, 1]}",
            "bad.yaml:2: object: boolean: the half-space that is union[1] of the tree is unbounded",
        ),
        (
            "object:\n  boolean:\n    union:\n      - {}\n      - half_space: {normal: [0, 0, 1]}",
            "bad.yaml:4: object.boolean.union[0]: a part of a boolean is exactly one of",
        ),
    ],
)
def test_a_bad_scene_is_refused_in_one_sentence(write: Write, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scene(write("bad.yaml", text))

    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_link_out_of_the_folder_does_not_lead_out(write: Write, tmp_path: Path) -> None:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "x.ply").symlink_to(SHIPPED / "pear.ply")
    scene = write("scenes/s.yaml", "object:\n  mesh: {file: x.ply, unit: mm}")

    with pytest.raises(InputError, match="must lie in the scene's own folder"):
        load_scene(scene)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("vaes", "there is no scene 'vaes'; did you mean 'vase'?"),
        ("no/such.yaml", "no/such.yaml: the scene does not exist"),
        ("none.yaml", "none.yaml: the scene does not exist"),
    ],
)
def test_a_scene_that_is_not_there_is_refused(name: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        find_scene(name)

    assert words in str(caught.value)


def test_a_folder_is_no_scene(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the scene is a folder"):
        find_scene(tmp_path)
