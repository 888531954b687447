from __future__ import annotations

import shutil

import numpy as np
import pytest

from palpate.core import recognition
from palpate.core.geometry import solidity
from palpate.launch.files import InputError, write_mesh
from palpate.launch.scene import load_scene
from palpate.nodes.specs import build_shape
from palpate.tools.recognition.object_database import (
    OBJECTS,
    ObjectDatabase,
    learn_models,
    learn_object,
    learned_path,
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
MODELS = load_models(SHIPPED)


def test_there_are_many_objects_of_all_kinds_of_a_hand_s_size():
    assert len(SHIPPED.entries) >= 32
    assert len({one.title for one in SHIPPED.entries.values()}) == len(SHIPPED.entries)
    kinds = ("superquadric", "hyperquadric", "generalised_cylinder", "polyhedron", "boolean")
    for kind in kinds:
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
def test_objects_of_the_shipped_scenes_are_those_of_the_scenes(name):
    there, here = load_scene(name).spec.object, SHIPPED.entries[name].object
    one, other = build_shape(there).mesh(3), build_shape(here).mesh(3)
    assert np.array_equal(one.faces, other.faces)
    shift = one.vertices[0] - other.vertices[0]
    assert np.abs(one.vertices - other.vertices - shift).max() < 1e-12


def test_what_is_stored_was_learned_of_these_objects_with_these_features():
    assert MODELS is not None, "learn the shipped objects again: see docs/recognition.md"
    assert MODELS.names == tuple(SHIPPED.entries)
    assert MODELS.means.shape == (len(SHIPPED.entries), len(recognition.FEATURES))
    assert np.linalg.eigvalsh(MODELS.correlation).min() > 0.0


QUICK = "gem"
SLOW = [pytest.param(one, marks=pytest.mark.slow) for one in SHIPPED.entries if one != QUICK]


@pytest.mark.parametrize("name", [QUICK, *SLOW])
def test_learning_again_gives_what_is_stored(name):
    scatter, which = learn_object(SHIPPED, name), MODELS.names.index(name)
    off = (scatter.vectors.mean(axis=0) - MODELS.means[which]) / MODELS.deviations[which]
    assert np.abs(off).max() < 0.1  # other machines round otherwise, and thresholds turn it up


def test_a_database_of_one_s_own_is_learned_written_and_read_back(write, monkeypatch):
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


def test_a_mesh_file_may_be_an_object(write, tmp_path):
    write_mesh(tmp_path / "part.ply", *build_shape(SHIPPED.entries["die"].object).mesh(3))
    text = "objects: {part: {title: a part, object: {mesh: {file: part.ply, unit: m}}}}"
    database = load_objects(write("mine.yaml", text))
    assert solidity(*build_shape(database.entries["part"].object).mesh(3)).watertight
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
def test_faults_are_told_with_file_and_line(write, old, new, words):
    assert old in TWO
    with pytest.raises(InputError, match=words):
        load_objects(write("f.yaml", TWO.replace(old, new, 1)))


def test_a_database_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match=r"none.yaml: cannot be read"):
        load_objects(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("freedom: ", "freedom: -", "freedom"),
        ("  box:", "  bax:", "is damaged; remove it, and it is learned again"),
        ("means: ", "means: 1.0 ", "is damaged"),
        ("correlation:\n", "correlation:\n  - '1.0 1.0'\n", "is damaged"),
    ],
)
def test_a_damaged_file_of_what_was_learned_is_one_sentence(tmp_path, old, new, words):
    path = tmp_path / "objects.yaml"
    shutil.copy(OBJECTS, path)
    text = learned_path(OBJECTS).read_text()
    assert old in text
    learned_path(path).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        load_models(ObjectDatabase(path, SHIPPED.entries))
