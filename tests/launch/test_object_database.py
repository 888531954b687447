"""The shipped objects and what was learned of them; databases of one's own."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from palpate.core import recognition
from palpate.core.geometry import solidity
from palpate.launch.files.mesh_file import write_mesh
from palpate.launch.files.source_map import InputError
from palpate.launch.scene import load_scene
from palpate.nodes.specs.objects import build_shape
from palpate.tools.recognition.object_database import (
    OBJECTS,
    ObjectDatabase,
    learn_models,
    load_models,
    load_objects,
    write_models,
)

TWO = """objects:
  ball:
    title: a ball
    object: {superquadric: {size: [0.03, 0.03, 0.03], exponents: [1.0, 1.0]}}
  block:
    title: a block
    object: {superquadric: {size: [0.02, 0.03, 0.04], exponents: [0.1, 0.1]}}
"""
SHIPPED = load_objects()
LEARNED = OBJECTS.with_name("objects_learned.yaml")
MODELS = load_models(SHIPPED)


def test_shipped_objects_are_closed_and_of_hand_size():
    assert len(SHIPPED.entries) >= 32
    assert len({one.title for one in SHIPPED.entries.values()}) == len(SHIPPED.entries)
    for kind in ["superquadric", "hyperquadric", "generalised_cylinder", "polyhedron", "boolean"]:
        assert any(getattr(one.object, kind) is not None for one in SHIPPED.entries.values())
    genera = {}
    for name, one in SHIPPED.entries.items():
        mesh = build_shape(one.object).mesh(3)
        found = solidity(*mesh)
        assert found.watertight, name
        sides = np.ptp(mesh.vertices, axis=0)
        assert 0.01 < sides.min() <= sides.max() < 0.2, name
        assert sides.max() > 0.03, name
        genera[name] = found.genus
    holed = ("mug", "pitcher", "napkin_ring", "tube", "hex_nut", "padlock")
    assert {name: genera[name] for name in holed} == dict.fromkeys(holed, 1)
    assert genera["plate_with_holes"] == 3
    assert genera["plate_with_pits"] == 0


@pytest.mark.parametrize("name", ["box", "cylinder", "sphere", "egg", "vase", "bottle", "gem"])
def test_objects_agree_with_scenes_of_their_name(name):
    there, here = load_scene(name).spec.object, SHIPPED.entries[name].object
    one, other = build_shape(there).mesh(3), build_shape(here).mesh(3)
    assert np.array_equal(one.faces, other.faces)
    shift = one.vertices[0] - other.vertices[0]
    assert np.abs(one.vertices - other.vertices - shift).max() < 1e-12


def test_stored_models_belong_to_these_objects_and_features():
    assert MODELS is not None, "learn the shipped objects again: see docs/recognition.md"
    assert MODELS.names == tuple(SHIPPED.entries)
    assert MODELS.means.shape == (len(SHIPPED.entries), len(recognition.FEATURES))
    assert np.linalg.eigvalsh(MODELS.correlation).min() > 0.0


@pytest.mark.slow
def test_learning_again_gives_what_is_stored():
    assert MODELS is not None
    names = ("gem", "mug", "die")
    few = ObjectDatabase(SHIPPED.path, {name: SHIPPED.entries[name] for name in names})
    again = learn_models(few, lambda _: None)
    which = [MODELS.names.index(name) for name in names]
    off = (again.means - MODELS.means[which]) / MODELS.deviations[which]
    assert np.abs(off).max() < 0.1  # other machines round otherwise, and thresholds turn it up


def test_own_database_is_learned_and_round_trips(write, monkeypatch):
    monkeypatch.setattr("palpate.tools.recognition.object_database.COPIES", 5)
    monkeypatch.setattr("palpate.tools.recognition.object_database.LEVELS", (2, 3))
    database, told = load_objects(write("mine.yaml", TWO)), []
    assert load_models(database) is None
    models = learn_models(database, told.append)
    assert told == ["ball", "block"]
    path = write_models(database, models)
    assert path.name == "mine_learned.yaml"
    again = load_models(database)
    for one, other in zip(models[1:5], again[1:5], strict=True):
        assert other == pytest.approx(one, rel=1e-4, abs=1e-12)
    assert recognition.recognise(models.means[0], again).name == "ball"
    changed = load_objects(write("mine.yaml", TWO.replace("0.04]", "0.05]")))
    assert load_models(changed) is None


def test_mesh_file_may_be_an_object(write, tmp_path):
    write_mesh(tmp_path / "part.ply", *build_shape(SHIPPED.entries["die"].object).mesh(3))
    text = "objects: {part: {title: a part, object: {mesh: {file: part.ply, unit: m}}}}"
    database = load_objects(write("mine.yaml", text))
    assert solidity(*build_shape(database.entries["part"].object).mesh(3)).watertight
    with pytest.raises(InputError, match=r"none.yaml: cannot be read"):
        load_objects(tmp_path / "none.yaml")
    with pytest.raises(InputError, match=r"mine.yaml:1: .*other.ply"):
        load_objects(write("mine.yaml", text.replace("part.ply", "other.ply")))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("0.03, 0.03]", "-0.03, 0.03]", r"f.yaml:4: objects.ball.object.superquadric.size\[1\]"),
        ("title: a ball", "titel: a ball", r"f.yaml:3: unknown key 'titel' .*'title'"),
        ("    title: a ball\n", "", r"f.yaml:\d: objects.ball lacks the key 'title'"),
        ("superquadric: {size: [0.02", "ball: {size: [0.02", r"f.yaml:7: unknown key 'ball'"),
        ("objects:", "things:", r"f.yaml:1: must be a map named objects"),
        ("  block:", "  none of them:", r"f.yaml:5: no object can be named 'none of them'"),
        ("  block:", "  ball:", r"f.yaml:5: the key 'ball' is given twice"),
        (TWO, "objects: {}", r"f.yaml:1: objects must hold at least one object"),
        (TWO, "objects: [1]", r"f.yaml:1: must be a map named objects"),
    ],
)
def test_faults_are_refused_with_file_and_line(write, old, new, words):
    assert old in TWO
    with pytest.raises(InputError, match=words):
        load_objects(write("f.yaml", TWO.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("freedom: ", "freedom: -", "freedom"),
        ("  box:", "  bax:", "is damaged; remove it, and it is learned again"),
        ("means: ", "means: 1.0 ", "is damaged"),
        ("correlation:\n", "correlation:\n  - '1.0 1.0'\n", "is damaged"),
    ],
)
def test_damaged_models_are_refused(tmp_path, old, new, words):
    path = tmp_path / "objects.yaml"
    shutil.copy(OBJECTS, path)
    text = LEARNED.read_text()
    assert old in text
    (tmp_path / LEARNED.name).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        load_models(ObjectDatabase(path, SHIPPED.entries))
