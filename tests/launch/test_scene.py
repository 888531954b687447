"""Scenes: read with their defaults, every fault in one sentence; meshes, effects, planners."""

import re

import numpy as np
import pytest
import trimesh

from palpate.core.explore.planners import PLANNER_NAMES, Uniform, make_planner, planner_type
from palpate.launch.files.source_map import InputError, SourceMapped, key_path
from palpate.launch.scene import check_planner, find_scene, load_scene, shipped_scenes
from palpate.nodes.specs.sensors import describe_effects
from palpate.tools.init import begin

BALL = "object:\n  superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}\n"


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scene_is_of_hand_size_and_round_trips(name, write):
    scene = load_scene(name)
    assert scene.name == name
    assert 0.05 <= max(scene.size) <= 0.15
    if not scene.inputs:
        assert load_scene(write("again.yaml", scene.text)).spec == scene.spec


IN_UNITS = """
object: {cone: {radius: 30mm, height: 6 cm, top: 1e3um}, pose: {position: [0, -1mm, 3cm]}}
sensor: {pitch: 1000µm, pad: {thickness: 3mm, radius: 1.5cm}}
world: {reach: 15cm}
effects: [gaussian_noise: {sigma: 10um}]
"""
IN_METRES = """
object: {cone: {radius: 0.03, height: 0.06, top: 0.001}, pose: {position: [0, -0.001, 0.03]}}
sensor: {pitch: 0.001, pad: {thickness: 0.003, radius: 0.015}}
world: {reach: 0.15}
effects: [gaussian_noise: {sigma: 1.0e-5}]
"""


def test_scene_has_defaults_places_size_and_lengths_with_units(write):
    scene = load_scene(write("ball.yaml", BALL))
    assert scene.name == "ball"
    assert scene.spec.sensor.rows == 16
    assert scene.located.value["seed"] == 0
    assert scene.located.place(("object", "superquadric", "size")).endswith("ball.yaml:2")
    assert scene.size == pytest.approx((0.08, 0.08, 0.08))
    units, metres = (load_scene(write("s.yaml", text)).spec for text in (IN_UNITS, IN_METRES))
    for key in ("object", "sensor", "world"):
        assert repr(getattr(units, key)) == repr(getattr(metres, key))
    assert describe_effects(units.effects) == describe_effects(metres.effects)


@pytest.mark.parametrize(("text", "words"), [
    ("", "bad.yaml: is empty"),
    ("object:\n  sphere: {radius: 30mmm}",
     "bad.yaml:2: object.sphere.radius is '30mmm'; expected number: the unit 'mmm' is none of"),
    ("object:\n  sphere: {radius: '0.03'}",
     "bad.yaml:2: object.sphere.radius is '0.03'; expected number: must have a unit: m, cm, mm"),
    (BALL + "sensor: {rows: 16mm}", "bad.yaml:3: sensor.rows is '16mm'; expected whole number"),
    ("seed: 3", "bad.yaml:1: the document lacks the key 'object'"),
    (BALL + "sede: 3", "bad.yaml:3: unknown key 'sede'; did you mean 'seed'?"),
    ("object:\n  superquadric:\n    size: [0.04, -0.03, 0.05]\n    exponents: [1, 1]",
     "bad.yaml:3: object.superquadric.size[1] is -0.03; expected number > 0.0"),
    (BALL + "seed: -1", "bad.yaml:3: seed is -1; expected whole number >= 0"),
    (BALL + "world: {reach: 0.05}", "but the finger reaches 0.05 m; enlarge world.reach"),
    ("object:\n  mesh: {file: none.ply, unit: mm}",
     "none.ply: the mesh cannot be read: No such file"),
    ("object:\n  mesh: {file: x.ply, unit: inch}",
     "bad.yaml:2: object.mesh.unit is 'inch'; expected one of cm, ft, in, m"),
    ("object:\n  generalised_cylinder:\n    section: {size: [0.03, 0.03]}\n"
     "    sweep: [[0.0, 1.0], [0.0, 0.5]]",
     "bad.yaml:2: object.generalised_cylinder: heights must increase, by 1e-09 m or more"),
    ("object:\n  boolean:\n    union:\n      - {}\n      - half_space: {normal: [0, 0, 1]}",
     "bad.yaml:4: object.boolean.union[0]: a part of a boolean is exactly one of"),
])  # fmt: skip
def test_bad_scene_is_refused_in_one_sentence(write, text, words):
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        load_scene(write("bad.yaml", text))
    assert "\n" not in str(caught.value)


def test_reach_fits_the_object_and_slices_of_a_thin_plate_are_refused(write):
    def reach(text):
        scene = load_scene(write("s.yaml", text))
        assert scene.located.value["world"]["reach"] == scene.spec.world.reach
        return scene.spec.world.reach

    large = BALL.replace("0.04, 0.04, 0.04", "0.04, 0.04, 0.1")
    assert reach(BALL) == 0.15
    assert reach(large) == pytest.approx(1.25 * 0.2)
    aside = BALL + "  pose: {position: [0.2, 0.0, 0.0]}\n"
    assert reach(aside) == pytest.approx(1.25 * 0.24)
    assert reach(large + "world: {reach: 0.3}\n") == 0.3
    with pytest.raises(InputError, match=r"the finger reaches 0\.15 m; enlarge world\.reach or"):
        reach(large + "world: {reach: 0.15}\n")
    plate = "object:\n  superquadric: {size: [0.04, 0.0015, 0.03], exponents: [0.3, 0.3]}\n"
    plate += "explore: {planner: %s}\n"
    assert load_scene(write("thin.yaml", plate % "touches")).size[1] == pytest.approx(0.003)
    with pytest.raises(InputError, match=r"is only 0\.003 m across; .* smaller than 0\.005 m"):
        load_scene(write("thin.yaml", plate % "predicted"))
    thinner = plate.replace("0.0015", "0.0009")
    with pytest.raises(InputError, match=r"is only 0\.0018 m across; .* smaller than 0\.002 m"):
        load_scene(write("thin.yaml", thinner % "touches"))


def box_file(folder, x=0.0, holes=0):
    mesh = trimesh.creation.box([60.0, 50.0, 40.0]).apply_translation([x, 0.0, 0.0])
    mesh = mesh.subdivide().subdivide().subdivide().subdivide()
    mesh.update_faces(np.arange(len(mesh.faces)) >= holes)
    mesh.export(folder / "box.ply")
    return folder / "box.ply"


def test_mesh_is_a_scene_of_its_own_and_moved_onto_the_axis(tmp_path, write):
    scene = load_scene(box_file(tmp_path, holes=1))
    guess = "box.ply: taken to be in mm, 60 x 50 x 40 mm"
    assert (scene.name, scene.size) == ("box", pytest.approx((0.06, 0.05, 0.04)))
    assert scene.mesh_notes.startswith(f"{guess}; 1 hole of up to ")
    assert load_scene(box_file(tmp_path)).mesh_notes == guess
    (tmp_path / "again.yaml").write_text(scene.text, encoding="utf-8")
    for place, file in scene.inputs.items():
        (tmp_path / place).parent.mkdir()
        (tmp_path / place).write_bytes(file.read_bytes())
    again = load_scene(tmp_path / "again.yaml")
    assert again.spec == load_scene(tmp_path / "box.ply").spec
    unit = {("object", "mesh", "unit"): SourceMapped("cm", "--unit")}
    assert load_scene(box_file(tmp_path), unit).mesh_notes == ""
    assert load_scene(box_file(tmp_path), unit).size == pytest.approx((0.6, 0.5, 0.4))
    size = {("object", "mesh", "size"): SourceMapped("12cm", "--set")}
    assert load_scene(box_file(tmp_path), size).size == pytest.approx((0.12, 0.1, 0.08))

    def middle(scene):
        mesh = scene.spec.object.mesh
        assert mesh is not None
        vertices = np.frombuffer(mesh.vertices, "<f8").reshape(-1, 3)
        return [*(0.5 * (vertices.min(axis=0) + vertices.max(axis=0)))[:2], vertices[:, 2].min()]

    box_file(tmp_path, x=31.0)
    text = "object:\n  mesh: {file: box.ply, unit: mm}\n"
    scene = load_scene(write("s.yaml", text))
    assert middle(scene) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert scene.mesh_notes == "box.ply: moved by -31, 0, 20 mm, from beside the axis onto it"
    kept = load_scene(write("s.yaml", text + "  pose: {position: [0.0, 0.0, 0.0]}\n"))
    assert (middle(kept), kept.mesh_notes) == (pytest.approx([0.031, 0.0, -0.02]), "")
    near = load_scene(box_file(tmp_path, x=29.0))
    assert middle(near) == pytest.approx([0.029, 0.0, -0.02])
    assert "moved" not in near.mesh_notes


def test_untrusted_scene_names_no_outer_file_or_program(write, tmp_path, monkeypatch):
    box_file(tmp_path)
    (tmp_path / "scenes").mkdir()
    above = write("scenes/s.yaml", "object:\n  mesh: {file: ../box.ply, unit: mm}\n")
    whole = f"object:\n  mesh: {{file: {tmp_path / 'box.ply'}, unit: mm}}\n"
    program = "object:\n  superquadric: {size: [0.03, 0.03, 0.03], exponents: [1, 1]}\n"
    with pytest.raises(InputError, match="must lie in the scene's own folder"):
        load_scene(above)
    monkeypatch.chdir(tmp_path)
    for scene in (above, write("scenes/t.yaml", whole)):
        assert load_scene(scene).inputs == {"inputs/box.ply": tmp_path / "box.ply"}
        with pytest.raises(InputError, match="must lie in the scene's own folder"):
            load_scene(scene, untrusted=True)
    for more in ("effects: ['os:system']", "explore: {planner: 'os:system'}"):
        with pytest.raises(InputError, match="'os:system' is a program, which an untrusted scene"):
            load_scene(write("u.yaml", program + more), untrusted=True)
    assert load_scene(write("v.yaml", program), untrusted=True).inputs == {}


def test_missing_scene_is_refused(tmp_path):
    for name, words in (
        ("vaes", "there is no scene 'vaes'; did you mean 'vase'?"),
        ("no/such.yaml", "no/such.yaml: the scene does not exist"),
        (tmp_path, "the scene is a folder"),
    ):
        with pytest.raises(InputError, match=re.escape(words)):
            find_scene(name)


def test_effects_are_parameters_by_name_or_by_ones_own_module(write, here):
    text = BALL + "effects:\n  - gaussian_noise: {sigma: 2e-5}\n  - drift\n  - creep:\n"
    effects = load_scene(write("s.yaml", text)).spec.effects
    assert effects == {"gaussian_noise": {"sigma": 2e-5}, "drift": {}, "creep": {}}
    for text in ("", "effects:\n", "effects: []\n"):
        assert load_scene(write("s.yaml", BALL + text)).spec.effects == {}
    text = BALL + "sensor: {signal: force}\neffects:\n  - temperature\n"
    with pytest.raises(InputError, match=r"bad\.yaml:5: .*temperature"):
        load_scene(write("bad.yaml", text))
    (here / "lab_effects").mkdir()
    write("lab_effects/__init__.py", "")
    begin("effect", "ringing", here / "lab_effects")
    text = BALL + "effects:\n  - lab_effects.ringing:Ringing: {size: 2e-6}\n"
    assert load_scene(write("s.yaml", text)).spec.effects == {
        "lab_effects.ringing:Ringing": {"size": 2e-6}
    }
    with pytest.raises(InputError, match=r"size is 9 m; expected 0 to 0\.001 m"):
        load_scene(write("bad.yaml", text.replace("2e-6", "9")))


NOISE = "\n  - gaussian_noise:\n      "


@pytest.mark.parametrize(("effects", "words"), [
    ("[noise]", "bad.yaml:3: there is no effect 'noise'"),
    ("[drfit]", "there is no effect 'drfit'; did you mean 'drift'?"),
    ("[3]", "bad.yaml:3: effects[0] must be one effect and its parameters"),
    ("[{drift: {}, creep: {}}]", "effects[0] must be one effect"),
    ("drift", "bad.yaml:3: effects must be a list"),
    ("[drift, drift]", "bad.yaml:3: effects lists 'drift' twice"),
    ("[drift, 'palpate.core.touch.effects.electronics:Drift']", "are the same effect"),
    ("[no.such:Module]", "bad.yaml:3: the effect 'no.such:Module' cannot be imported"),
    (NOISE + "sigma: -1", "bad.yaml:5: effects.gaussian_noise: sigma is -1 m; expected 0 to 0.001"),
    (NOISE + "sigmo: 1", "unknown key 'sigmo' in effects.gaussian_noise; did you mean 'sigma'?"),
    (NOISE + "sigma: much", "bad.yaml:5: effects.gaussian_noise.sigma is 'much'; expected number"),
])  # fmt: skip
def test_bad_effects_are_refused_in_one_sentence(write, effects, words):
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        load_scene(write("bad.yaml", BALL + f"effects: {effects}\n"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("old", "new", "words"), [
    ("import math", "def (", "cannot be imported: SyntaxError"),
    ("import math", "import sys; sys.exit(0)", "cannot be imported: SystemExit"),
    ("Phase.SIGNAL", "6", "its phase must be one of Phase"),
    ("Annotated[float", "Annotated[flaot", "cannot be imported: NameError"),
])  # fmt: skip
def test_module_that_is_no_effect_is_refused(old, new, words, write, here):
    (path, _), named = begin("effect", "odd", here)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        load_scene(write("s.yaml", BALL + f"effects:\n  - {named}\n"))
    assert re.search(r"s\.yaml:[34]: ", str(caught.value))
    assert "\n" not in str(caught.value)


def test_planner_has_its_settings_or_is_ones_own_or_a_default(typed, here):
    document = typed("explore: {planner: uniform, settings: {count: 5, order: nested}}")
    assert check_planner(document) == Uniform(count=5, order="nested")
    made = check_planner(typed("explore: {settings: {cover: 5}}"))
    assert isinstance(made, planner_type(PLANNER_NAMES[0]))
    assert getattr(made, "cover") == 5  # noqa: B009
    for name in PLANNER_NAMES:
        named = typed(f"explore:\n  planner: {name}\n  settings:\n")
        assert check_planner(named) == make_planner(name, {})
    for text in ("seed: 3", "explore: {tolerance: 2.0e-4}", "explore: 3"):
        assert check_planner(typed(text)) is None
    _, named = begin("planner", "found_here", here)
    made = check_planner(typed(f"explore:\n  planner: {named}\n  settings: {{most_bow: 2.0}}"))
    assert type(made).__name__ == "FoundHere"
    with pytest.raises(InputError, match=r"f.yaml:3: explore.settings: most_bow is 0; exp"):
        check_planner(typed(f"explore:\n  planner: {named}\n  settings: {{most_bow: 0.0}}"))


@pytest.mark.parametrize(("text", "words"), [
    ("planner: unifrom", "f.yaml:2: there is no planner 'unifrom'; did you mean 'uniform'?"),
    ("planner: 3", "f.yaml:2: explore.planner is 3; it must be a name, as predicted"),
    ("planner: json:loads", "'json:loads' is no planner: 'loads' must be a frozen dataclass"),
    ("settings: 3", "explore.settings is 3; it must be a map of numbers"),
    ("settings: {covr: 5}", "covr"),
    ("settings: {cover: 5.5}", "explore.settings.cover is 5.5; expected whole number"),
    ("settings: {cover: many}", "explore.settings.cover is 'many'; expected whole number"),
    ("settings: {travel: .nan}", "travel is nan; a number must be finite"),
])  # fmt: skip
def test_bad_planner_is_refused_with_its_line(typed, text, words):
    with pytest.raises(InputError, match=re.escape(words)):
        check_planner(typed(f"explore:\n  {text}"))


def changed(write, text="", **changes):
    """A scene of a ball with values in place of its own, by paths with __ between the keys."""
    given = {key_path(f".{path.replace('__', '.')}"): value for path, value in changes.items()}
    places = enumerate(given.items())
    located = {path: SourceMapped(value, f"here:{i}") for i, (path, value) in places}
    return load_scene(write("ball.yaml", BALL + text), located)


def test_changed_values_and_effects_are_in_the_text_of_the_scene(write):
    even = {"explore__planner": "uniform", "explore__settings": {"count": 4}}
    scene = changed(write, sensor__pitch=1.2e-3, **even)
    assert scene.spec.sensor.pitch == 1.2e-3
    place = ("object", "superquadric", "size", 2)
    larger = load_scene(write("ball.yaml", BALL), {place: SourceMapped(0.03, "here")})
    assert larger.spec.object.superquadric.size == (0.04, 0.04, 0.03)
    assert scene.spec.explore == {"planner": "uniform", "settings": {"count": 4}}
    again = load_scene(write("told.yaml", scene.text))
    assert again.spec == scene.spec
    listed = "effects:\n  - drift\n  - gaussian_noise: {sigma: 1.0e-6}\n"
    sigmas = {"effects__gaussian_noise__sigma": 2e-6, "effects__pose_error__sigma": 1e-4}
    scene = changed(write, listed, **sigmas)
    assert scene.spec.effects["gaussian_noise"] == {"sigma": 2e-6}
    assert list(scene.spec.effects) == ["drift", "gaussian_noise", "pose_error"]
    assert changed(write, listed, effects=[]).spec.effects == {}


@pytest.mark.parametrize(("changes", "complaint"), [
    ({"sensor__pich": 1e-3}, "here:0: unknown key 'pich' in sensor; did you mean 'pitch'?"),
    ({"sensr__pitch": 1e-3}, "here:0: unknown key 'sensr'; did you mean 'sensor'?"),
    ({"world__reach": 0.2, "sensor__pitch": -1}, "here:1: sensor.pitch is -1; expected number"),
    ({"effects__salt": {}}, "here:0: there is no effect 'salt'"),
    ({"effects__drift__rate_": 1}, "here:0: unknown key 'rate_' in effects.drift"),
    ({"seed__deep": 1}, "here:0: seed is 7, which has no deep to set"),
])  # fmt: skip
def test_bad_change_is_refused_where_it_was_asked_for(write, changes, complaint):
    with pytest.raises(InputError, match=re.escape(complaint)):
        changed(write, "seed: 7\n", **changes)
