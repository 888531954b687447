"""The shipped objects and what was learned of them; solids recognised among stored objects."""

import json
import shutil

import numpy as np
import pytest

from palpate.core.geometry import solidity
from palpate.core.recognition import FEATURES, NONE, noisy_copy
from palpate.launch.files.mesh_file import write_mesh
from palpate.launch.files.source_map import InputError
from palpate.nodes.specs.objects import build_shape
from palpate.tools.recognition import object_database
from palpate.tools.recognition.recognising import recognise, recognition_text

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
    assert len({entry.title for entry in SHIPPED.entries.values()}) == len(SHIPPED.entries)
    for kind in ["superquadric", "hyperquadric", "generalised_cylinder", "polyhedron", "boolean"]:
        assert any(getattr(entry.object, kind) is not None for entry in SHIPPED.entries.values())
    genera = {}
    for name, entry in SHIPPED.entries.items():
        mesh = build_shape(entry.object).mesh(3)
        shape = solidity(*mesh)
        assert shape.watertight, name
        sides = np.ptp(mesh.vertices, axis=0)
        assert 0.01 < sides.min() <= sides.max() < 0.2, name
        assert sides.max() > 0.03, name
        genera[name] = shape.genus
    holed = ("mug", "pitcher", "napkin_ring", "tube", "hex_nut", "padlock")
    assert {name: genera[name] for name in holed} == dict.fromkeys(holed, 1)
    assert genera["plate_with_holes"] == 3
    assert genera["plate_with_pits"] == 0
    # The stored models belong to these objects and features.
    assert MODELS is not None, "learn the shipped objects again: see docs/recognition.md"
    assert MODELS.names == tuple(SHIPPED.entries)
    assert MODELS.means.shape == (len(SHIPPED.entries), len(FEATURES))
    assert np.linalg.eigvalsh(MODELS.correlation).min() > 0.0


@pytest.mark.slow
def test_learning_again_gives_stored_models():
    assert MODELS is not None
    names = ("gem", "mug", "die")
    entries = {name: SHIPPED.entries[name] for name in names}
    few = object_database.ObjectDatabase(SHIPPED.path, entries)
    again = object_database.learn_models(few, lambda _: None)
    which = [MODELS.names.index(name) for name in names]
    off = (again.means - MODELS.means[which]) / MODELS.deviations[which]
    assert np.abs(off).max() < 0.1  # other machines round otherwise, and thresholds turn it up


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


def copy_of(name, scale=1.0):
    mesh = build_shape(SHIPPED.entries[name].object).mesh(4)
    mesh = mesh._replace(vertices=scale * mesh.vertices)
    return noisy_copy(mesh, np.random.default_rng(11))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run directory with a mug, one with something else, and the file of an egg."""
    made = tmp_path_factory.mktemp("runs")
    for name, scale in (("mug", 1.0), ("bottle", 1.3)):
        run = made / name
        run.mkdir()
        write_mesh(run / "mesh.ply", *copy_of(name, scale))
        (run / "summary.json").write_text('{"rms_bound_95_m": 0.00012}')
    write_mesh(made / "egg.stl", *copy_of("egg"))
    return made


def test_stored_object_is_recognised_with_its_runner_up(folder, call):
    code, out, _ = call("recognise", folder / "mug", "--json")
    record = json.loads(out)
    assert code == 0
    assert (record["recognised"], record["object"]) == (True, "mug")
    assert record["probability"] > 0.9 and record["uncertainty_m"] >= 0.00012
    assert sum(record["probabilities"].values()) == pytest.approx(1.0)
    assert record["runner_up"] not in ("mug", NONE) and len(record["differences"]) == 3
    lines = recognition_text(record).splitlines()
    assert lines[0].startswith("object     mug (coffee mug of 80 by 95 mm with a handle), prob")
    assert lines[1].startswith("runner-up  ")
    assert any(line.startswith("differs ") for line in lines)


def test_unknown_object_is_none_with_the_reason(folder, call):
    code, out, _ = call("recognise", folder / "bottle", "--json")
    record = json.loads(out)
    assert (code, record["recognised"], record["object"]) == (1, False, NONE)
    assert record["distance"] > record["limit"] and record["runner_up"] in SHIPPED.entries
    text = " ".join(recognition_text(record).split())
    assert text.startswith("object none of them, probability 100 % nearest ")
    assert "where 99 in 100 copies are within" in text


@pytest.mark.slow
def test_mesh_file_is_recognised_in_its_unit(folder):
    path = folder / "egg.stl"
    assert recognise(path, unit="mm") == recognise(path)  # only mm is likely
    assert recognise(path)["object"] == "egg" and recognise(path, unit="cm")["object"] == NONE


def test_files_without_a_solid_are_refused(tmp_path, refusal):
    (tmp_path / "a.txt").write_text("1 2 3")
    for name, words in (
        ("none", "does not exist"),
        ("", "holds no rebuilt solid: there is no mesh.ply in it"),
        ("a.txt", "'txt' is no mesh format"),
    ):
        assert words in refusal("recognise", tmp_path / name)
    vertices, faces = copy_of("egg")
    write_mesh(tmp_path / "open.ply", vertices, faces[:3])
    with pytest.raises(InputError, match=r"open.ply: "):
        recognise(tmp_path / "open.ply", unit="m")


@pytest.mark.slow
def test_own_objects_are_learned_once_and_again_if_changed(tmp_path, write):
    learning = object_database.LearningSettings(n_copies=6, levels=(3, 4))
    own, said = write("own.yaml", TWO), []
    options = {"unit": "m", "objects": own, "say": said.append, "learning": learning}
    database = object_database.load_objects(own)
    block = build_shape(database.entries["block"].object)
    write_mesh(tmp_path / "block.ply", *noisy_copy(block.mesh(4), np.random.default_rng(11)))
    record = recognise(tmp_path / "block.ply", **options)
    assert (record["object"], record["runner_up"]) == ("block", "ball")
    assert said[:2] == ["learning ball", "learning block"]
    assert (tmp_path / "own_learned.yaml").is_file()
    said.clear()
    assert recognise(tmp_path / "block.ply", **options) == record
    assert said == []
    again = object_database.load_models(database)
    models = object_database.learn_models(database, said.append, learning)
    for learned, other in zip(models[1:5], again[1:5], strict=True):
        assert other == pytest.approx(learned, rel=1e-4, abs=1e-12)
    changed = object_database.load_objects(write("own.yaml", TWO.replace("0.04]", "0.05]")))
    assert object_database.load_models(changed) is None
