from __future__ import annotations

import json

import numpy as np
import pytest

from palpate.core.recognition import NONE, noisy_copy
from palpate.launch.files import InputError, write_mesh
from palpate.nodes.specs import build_shape
from palpate.tools.cli import command_line as cli
from palpate.tools.recognition.object_database import load_objects
from palpate.tools.recognition.recognising import recognise, recognition_text

ENTRIES = load_objects().entries


def copy_of(name, scale=1.0, seed=11):
    mesh = build_shape(ENTRIES[name].object).mesh(4)
    return noisy_copy(mesh._replace(vertices=scale * mesh.vertices), np.random.default_rng(seed))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run directory with a mug, one with something else, and files of an egg."""
    made = tmp_path_factory.mktemp("runs")
    for name, scale in (("mug", 1.0), ("bottle", 1.3)):
        run = made / name
        run.mkdir()
        write_mesh(run / "mesh.ply", *copy_of(name, scale))
        (run / "summary.json").write_text('{"rms_bound_95_m": 0.00012}')
    write_mesh(made / "egg.stl", *copy_of("egg"))
    return made


def test_a_run_is_recognised_with_its_probability_and_what_told_it_apart(folder):
    found = recognise(folder / "mug")
    assert (found["recognised"], found["object"]) == (True, "mug")
    assert found["probability"] > 0.9
    assert sum(found["probabilities"].values()) == pytest.approx(1.0)
    assert found["runner_up"] not in ("mug", NONE)
    assert found["uncertainty_m"] >= 0.00012
    assert len(found["differences"]) == 3
    lines = recognition_text(found).splitlines()
    assert lines[0].startswith("object     mug (coffee mug of 80 by 95 mm with a handle), prob")
    assert lines[1].startswith("runner-up  ")
    assert any(line.startswith("told apart ") for line in lines)


def test_what_is_not_stored_is_none_of_them_with_the_reason(folder):
    found = recognise(folder / "bottle")
    assert (found["recognised"], found["object"]) == (False, NONE)
    assert found["distance"] > found["limit"]
    text = " ".join(recognition_text(found).split())
    assert text.startswith("object none of them, probability 100 % nearest ")
    assert "where 99 in 100 copies are within" in text


def test_a_mesh_file_is_recognised_in_its_unit(folder):
    assert recognise(folder / "egg.stl", unit="mm")["object"] == "egg"
    assert recognise(folder / "egg.stl")["object"] == "egg"  # only mm is likely
    assert recognise(folder / "egg.stl", unit="cm")["object"] == NONE


def test_the_verb_exits_with_what_it_found(folder, capsys):
    assert cli.run(["recognise", str(folder / "mug")]) == 0
    assert capsys.readouterr().out.startswith("object     mug")
    assert cli.run(["recognise", str(folder / "bottle"), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["object"] == NONE
    assert found["runner_up"] in ENTRIES


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path / "none", "does not exist"),
        (lambda path: path, "holds no rebuilt solid: there is no mesh.ply in it"),
        (lambda path: _written(path, "a.ply", b"ply\n"), "is no mesh in PLY"),
        (lambda path: _written(path, "a.txt", b"1 2 3"), "'txt' is no mesh format"),
        (lambda path: _written(path, "a.ply", b""), "the mesh file is empty"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path, capsys, make, words):
    assert cli.run(["recognise", str(make(tmp_path))]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


def _written(folder, name, content):
    (folder / name).write_bytes(content)
    return folder / name


def test_an_open_surface_is_refused(tmp_path):
    vertices, faces = copy_of("egg")
    write_mesh(tmp_path / "open.ply", vertices, faces[200:])
    with pytest.raises(InputError, match=r"open.ply: "):
        recognise(tmp_path / "open.ply", unit="m")


def test_objects_of_one_s_own_are_learned_and_kept(tmp_path, write, monkeypatch):
    monkeypatch.setattr("palpate.tools.recognition.object_database.COPIES", 6)
    monkeypatch.setattr("palpate.tools.recognition.object_database.LEVELS", (3, 4))
    own = write(
        "own.yaml",
        "objects:\n"
        "  ball: {title: a ball, object: {superquadric:"
        " {size: [0.03, 0.03, 0.03], exponents: [1.0, 1.0]}}}\n"
        "  egg: {title: an egg, object: {superquadric: {size: [0.03, 0.03, 0.04],"
        " exponents: [1.0, 1.0], taper: [-0.2, -0.2]}}}\n",
    )
    write_mesh(tmp_path / "egg.ply", *copy_of("egg"))
    told = []
    found = recognise(tmp_path / "egg.ply", unit="m", objects=own, say=told.append)
    assert (found["object"], found["runner_up"]) == ("egg", "ball")
    assert told[:2] == ["learning ball", "learning egg"]
    assert (tmp_path / "own_learned.yaml").is_file()
    told.clear()
    assert recognise(tmp_path / "egg.ply", unit="m", objects=own, say=told.append) == found
    assert told == []
