"""Solids recognised among stored objects, with probabilities and reasons."""

import json

import numpy as np
import pytest

from palpate.core.recognition import NONE, noisy_copy
from palpate.launch.files.mesh_file import write_mesh
from palpate.launch.files.source_map import InputError
from palpate.nodes.specs.objects import build_shape
from palpate.tools.recognition.object_database import load_objects
from palpate.tools.recognition.recognising import recognise, recognition_text

ENTRIES = load_objects().entries


def copy_of(name, scale=1.0):
    mesh = build_shape(ENTRIES[name].object).mesh(4)
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
    found = json.loads(out)
    assert code == 0
    assert (found["recognised"], found["object"]) == (True, "mug")
    assert found["probability"] > 0.9 and found["uncertainty_m"] >= 0.00012
    assert sum(found["probabilities"].values()) == pytest.approx(1.0)
    assert found["runner_up"] not in ("mug", NONE) and len(found["differences"]) == 3
    lines = recognition_text(found).splitlines()
    assert lines[0].startswith("object     mug (coffee mug of 80 by 95 mm with a handle), prob")
    assert lines[1].startswith("runner-up  ")
    assert any(line.startswith("told apart ") for line in lines)


def test_unknown_object_is_none_with_the_reason(folder, call):
    code, out, _ = call("recognise", folder / "bottle", "--json")
    found = json.loads(out)
    assert (code, found["recognised"], found["object"]) == (1, False, NONE)
    assert found["distance"] > found["limit"] and found["runner_up"] in ENTRIES
    text = " ".join(recognition_text(found).split())
    assert text.startswith("object none of them, probability 100 % nearest ")
    assert "where 99 in 100 copies are within" in text


@pytest.mark.slow
def test_mesh_file_is_recognised_in_its_unit(folder):
    path = folder / "egg.stl"
    assert recognise(path, unit="mm") == recognise(path)  # only mm is likely
    assert recognise(path)["object"] == "egg" and recognise(path, unit="cm")["object"] == NONE


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none", None, "does not exist"),
        ("", None, "holds no rebuilt solid: there is no mesh.ply in it"),
        ("a.ply", b"ply\n", "is no mesh in PLY"),
        ("a.txt", b"1 2 3", "'txt' is no mesh format"),
        ("a.ply", b"", "the mesh file is empty"),
    ],
)
def test_files_without_a_solid_are_refused(tmp_path, refusal, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert words in refusal("recognise", tmp_path / name)
    vertices, faces = copy_of("egg")
    write_mesh(tmp_path / "open.ply", vertices, faces[200:])
    with pytest.raises(InputError, match=r"open.ply: "):
        recognise(tmp_path / "open.ply", unit="m")


@pytest.mark.slow
def test_own_objects_are_learned_once(tmp_path, write, monkeypatch):
    monkeypatch.setattr("palpate.tools.recognition.object_database.COPIES", 6)
    monkeypatch.setattr("palpate.tools.recognition.object_database.LEVELS", (3, 4))
    ball = "exponents: [1.0, 1.0], size: [0.03, 0.03, 0.03"
    lines = [f"  ball: {{title: a ball, object: {{superquadric: {{{ball}]}}}}}}"]
    egg = ball.replace("0.03, 0.03, 0.03", "0.03, 0.03, 0.04") + "], taper: [-0.2, -0.2"
    lines += [f"  egg: {{title: an egg, object: {{superquadric: {{{egg}]}}}}}}"]
    own = write("own.yaml", "\n".join(["objects:", *lines, ""]))
    write_mesh(tmp_path / "egg.ply", *copy_of("egg"))
    said: list[str] = []
    found = recognise(tmp_path / "egg.ply", unit="m", objects=own, say=said.append)
    assert (found["object"], found["runner_up"]) == ("egg", "ball")
    assert said[:2] == ["learning ball", "learning egg"]
    assert (tmp_path / "own_learned.yaml").is_file()
    said.clear()
    assert recognise(tmp_path / "egg.ply", unit="m", objects=own, say=said.append) == found
    assert said == []
