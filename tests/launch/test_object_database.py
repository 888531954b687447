"""The shipped objects and what was learned of them; databases of one's own."""

import shutil

import numpy as np
import pytest

from palpate.core import recognition
from palpate.core.geometry import solidity
from palpate.launch.files.mesh_file import write_mesh
from palpate.launch.files.source_map import InputError
from palpate.nodes.specs.objects import build_shape
from palpate.tools.recognition import object_database

TWO = """objects:
  ball:
    title: a ball
    object: {superquadric: {size: [0.03, 0.03, 0.03], exponents: [1.0, 1.0]}}
  block:
    title: a block
    object: {superquadric: {size: [0.02, 0.03, 0.04], exponents: [0.1, 0.1]}}
"""
SHIPPED = object_database.load_objects()
LEARNED = object_database.OBJECTS.with_name("objects_learned.yaml")
MODELS = object_database.load_models(SHIPPED)


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


def test_stored_models_belong_to_these_objects_and_features():
    assert MODELS is not None, "learn the shipped objects again: see docs/recognition.md"
    assert MODELS.names == tuple(SHIPPED.entries)
    assert MODELS.means.shape == (len(SHIPPED.entries), len(recognition.FEATURES))
    assert np.linalg.eigvalsh(MODELS.correlation).min() > 0.0


@pytest.mark.slow
def test_learning_again_gives_what_is_stored():
    assert MODELS is not None
    names = ("gem", "mug", "die")
    few = object_database.ObjectDatabase(
        SHIPPED.path, {name: SHIPPED.entries[name] for name in names}
    )
    again = object_database.learn_models(few, lambda _: None)
    which = [MODELS.names.index(name) for name in names]
    off = (again.means - MODELS.means[which]) / MODELS.deviations[which]
    assert np.abs(off).max() < 0.1  # other machines round otherwise, and thresholds turn it up


@pytest.mark.slow
def test_own_database_is_learned_and_round_trips(write, monkeypatch):
    monkeypatch.setattr("palpate.tools.recognition.object_database.COPIES", 4)
    monkeypatch.setattr("palpate.tools.recognition.object_database.LEVELS", (2, 3))
    database, told = object_database.load_objects(write("mine.yaml", TWO)), []
    assert object_database.load_models(database) is None
    models = object_database.learn_models(database, told.append)
    assert told == ["ball", "block"]
    path = object_database.write_models(database, models)
    assert path.name == "mine_learned.yaml"
    again = object_database.load_models(database)
    for one, other in zip(models[1:5], again[1:5], strict=True):
        assert other == pytest.approx(one, rel=1e-4, abs=1e-12)
    assert recognition.recognise(models.means[0], again).name == "ball"
    changed = object_database.load_objects(write("mine.yaml", TWO.replace("0.04]", "0.05]")))
    assert object_database.load_models(changed) is None


def test_mesh_file_may_be_an_object(write, tmp_path):
    write_mesh(tmp_path / "part.ply", *build_shape(SHIPPED.entries["die"].object).mesh(3))
    text = "objects: {part: {title: a part, object: {mesh: {file: part.ply, unit: m}}}}"
    database = object_database.load_objects(write("mine.yaml", text))
    assert solidity(*build_shape(database.entries["part"].object).mesh(3)).watertight
    with pytest.raises(InputError, match=r"none.yaml: cannot be read"):
        object_database.load_objects(tmp_path / "none.yaml")
    with pytest.raises(InputError, match=r"mine.yaml:1: .*other.ply"):
        object_database.load_objects(write("mine.yaml", text.replace("part.ply", "other.ply")))


@pytest.mark.parametrize(("old", "new", "words"), [
    ("0.03, 0.03]", "-0.03, 0.03]", r"f.yaml:4: objects.ball.object.superquadric.size\[1\]"),
    ("title: a ball", "titel: a ball", r"f.yaml:3: unknown key 'titel' .*'title'"),
    ("    title: a ball\n", "", r"f.yaml:\d: objects.ball lacks the key 'title'"),
    ("superquadric: {size: [0.02", "ball: {size: [0.02", r"f.yaml:7: unknown key 'ball'"),
    ("objects:", "things:", r"f.yaml:1: must be a map named objects"),
    ("  block:", "  none of them:", r"f.yaml:5: no object can be named 'none of them'"),
    ("  block:", "  ball:", r"f.yaml:5: the key 'ball' is given twice"),
    (TWO, "objects: {}", r"f.yaml:1: objects must hold at least one object"),
])  # fmt: skip
def test_faults_are_refused_with_file_and_line(write, old, new, words):
    assert old in TWO
    with pytest.raises(InputError, match=words):
        object_database.load_objects(write("f.yaml", TWO.replace(old, new, 1)))


@pytest.mark.parametrize(("old", "new", "words"), [
    ("freedom: ", "freedom: -", "freedom"),
    ("  box:", "  bax:", "is damaged; remove it, and it is learned again"),
    ("means: ", "means: 1.0 ", "is damaged"),
    ("correlation:\n", "correlation:\n  - '1.0 1.0'\n", "is damaged"),
])  # fmt: skip
def test_damaged_models_are_refused(tmp_path, old, new, words):
    path = tmp_path / "objects.yaml"
    shutil.copy(object_database.OBJECTS, path)
    text = LEARNED.read_text()
    assert old in text
    (tmp_path / LEARNED.name).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        object_database.load_models(object_database.ObjectDatabase(path, SHIPPED.entries))
