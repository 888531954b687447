import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import pytest

from palpate.core.explore.tracing.contour_path import TOUCH_DEPTH
from palpate.launch.files.source_map import InputError
from palpate.launch.node_kinds import list_kinds
from palpate.launch.scene import SHIPPED_SCENES
from palpate.tools.cli import command_line as cli


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_linear_algebra_has_one_thread_unless_the_user_wants_more(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    monkeypatch.delenv("OMP_NUM_THREADS")
    monkeypatch.setattr(cli.signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit):
        cli.main(["--version"])
    assert (os.environ["OPENBLAS_NUM_THREADS"], os.environ["OMP_NUM_THREADS"]) == ("3", "1")


def sentence(output):
    """The one line on standard error, which is all that there may be."""
    out, err = output.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "Traceback" not in err
    return err


def test_help_lists_the_verbs_without_importing_one():
    code = (
        "import sys; from palpate.tools.cli.command_line import run; "
        "run(['--help']); print(*sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=True
    )
    *text, modules = done.stdout.splitlines()
    for verb in ("run", "launch", "replay", "bag", "scene", "node", "topic", "doctor", "dev"):
        assert any(line.startswith(f"  {verb} ") for line in text)
    assert not {"numpy", "msgspec", "rich", "palpate.tools.cli.launching"} & set(modules.split())


def test_the_version_is_reported(capsys):
    assert cli.run(["--version"]) == 0
    assert re.fullmatch(r"palpate, version \d+\.\d+\.\d+\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["lanch"], "there is no command 'lanch'; did you mean 'launch'? (see palpate --help)"),
        (["bench"], "sweep, topic, view (see palpate --help)"),
        (["run", "--sed", "3"], "No such option"),
        (["run", "vase", "--seed", "-3"], "-3 is not in the range"),
        (["run", "vaes"], "there is no scene 'vaes'; did you mean 'vase'?"),
        (["run", "vase", "--fingers", "0"], "--fingers: fingers must be 1 to 8, got 0"),
        (["launch", "explore.yaml", "fingers:=many"], "fingers must be 1 to 8, got 'many'"),
        (["run", "none.yaml"], "none.yaml: the scene does not exist"),
        (["run", "vase", "--set", "x"], "--set x: must look like planner.tolerance=0.2e-3"),
        (["launch"], "Missing argument 'FILE'"),
        (["launch", "none.yaml"], "none.yaml: the launch file does not exist"),
        (["launch", "explore.yaml", "scene=box"], "an argument must look like scene:=vase"),
        (["launch", "explore.yaml", "scen:=box"], "has no argument 'scen'; did you mean 'scene'"),
        (["replay"], "Missing argument 'BAG'"),
        (["replay", "x.mcap"], "x.mcap: the recording does not exist"),
        (["replay", "x.mcap", "--set", "x"], "--set x: must look like planner.tolerance=0.2e-3"),
        (["bag", "dif"], "there is no command 'dif'; did you mean 'diff'?"),
        (["bag", "diff", "x.mcap"], "Missing argument 'B'"),
        (["bag", "diff", "x.mcap", "y.mcap"], "x.mcap: the recording does not exist"),
        (["scene", "check", "none.yaml"], "none.yaml: the scene does not exist"),
        (
            ["node", "kinds", "plannet"],
            "there is no kind of node 'plannet'; did you mean 'planner'",
        ),
        (["bag", "inof", "x.mcap"], "there is no command 'inof'; did you mean 'info'?"),
        (["bag", "info", "x.mcap"], "x.mcap: the recording does not exist"),
        (["bag", "recover", "x.mcap"], "x.mcap: the recording does not exist"),
        (["bag", "export", "x.mcap", "-o", "y"], "Missing option '--format'"),
        (["bag", "export", "x.mcap", "-o", "y", "--format", "csv"], "x.mcap: the recording does"),
        (["dev", "bench", "bux"], "'bux' is not one of"),
        (["init", "effect", "Hum"], "'Hum' cannot name a module"),
        (["topic", "ecko"], "there is no command 'ecko'; did you mean 'echo'? (see palpate topic"),
        (["topic", "echo"], "Missing argument 'TOPIC'"),
        (["topic", "hz"], "name at least one topic, or take --all of them, not both"),
        (["topic", "hz", "/a", "--all"], "name at least one topic, or take --all of them, not"),
        (["topic", "hz", "/a", "--window", "1"], "1 is not in the range"),
        (["init", "efect", "hum"], "there is no command 'efect'; did you mean 'effect'?"),
        (["calibrate"], "Missing argument 'SCENE'"),
        (["calibrate", "vaes"], "there is no scene 'vaes'; did you mean 'vase'?"),
    ],
)
def test_a_wrong_command_line_is_refused_in_one_sentence(home, capsys, arguments, words):
    assert cli.run(arguments) == 2
    assert words in sentence(capsys)
    assert list(home.iterdir()) == []


BAD_SCENES = {
    "empty": ("", "is empty"),
    "not YAML": ("a: [", "is not YAML"),
    "unknown key": ("objekt: 3", "did you mean 'object'?"),
    "negative size": (
        "object: {superquadric: {size: [1, -1, 1], exponents: [1, 1]}}",
        "size[1] is -1; expected number > 0.0",
    ),
    "not finite": (
        "object: {superquadric: {size: [1, .nan, 1], exponents: [1, 1]}}",
        "size[1] is nan; a number must be finite",
    ),
    "unknown effect": (
        "object: {superquadric: {size: [1, 1, 1], exponents: [1, 1]}}\neffects: [drifft]",
        "did you mean 'drift'?",
    ),
    "effect out of range": (
        "object: {superquadric: {size: [1, 1, 1], exponents: [1, 1]}}\n"
        "effects:\n- drift: {rate: 9}",
        "rate is 9 m/sqrt(s); expected 0 to 0.0001 m/sqrt(s)",
    ),
    "array too small": (
        "object: {superquadric: {size: [1, 1, 1], exponents: [1, 1]}}\nsensor: {rows: 3}",
        "sensor.rows is 3; expected whole number >= 4",
    ),
    "pad too thin": (
        "object: {superquadric: {size: [1, 1, 1], exponents: [1, 1]}}\n"
        "sensor: {pad: {thickness: 0.001}}",
        f"it must be at least {TOUCH_DEPTH / 0.8:.3g} m, to be pressed by {TOUCH_DEPTH} m",
    ),
    "mesh missing": ("object: {mesh: {file: no.ply, unit: mm}}", "no.ply: the mesh cannot be read"),
    "mesh empty": ("object: {mesh: {file: empty.ply, unit: mm}}", "the mesh file is empty"),
    "mesh open": ("object: {mesh: {file: open.off, unit: mm}}", "is open: it has a hole"),
    "mesh without unit": ("object: {mesh: {file: whole.off}}", "in a unit that the file does not"),
    "mesh not finite": ("object: {mesh: {file: nan.off, unit: mm}}", "vertex 0 is not finite"),
}


def off(first, closed):
    faces = ["3 0 2 1", "3 0 1 3", "3 0 3 2", "3 1 2 3"][: 4 if closed else 3]
    return "\n".join(["OFF", f"4 {len(faces)} 0", first, "10 0 0", "0 10 0", "0 0 10", *faces, ""])


@pytest.mark.parametrize("verb", [["run"], ["run", "--json"], ["scene", "check"]])
@pytest.mark.parametrize("name", BAD_SCENES)
def test_a_bad_scene_ends_with_2_and_one_sentence_and_leaves_nothing(
    write, home, capsys, name, verb
):
    text, words = BAD_SCENES[name]
    write("empty.ply", "")
    write("open.off", off("0 0 0", closed=False))
    write("whole.off", off("0 0 0", closed=True))
    write("nan.off", off("nan 0 0", closed=True))
    write("bad.yaml", text)
    before = sorted(home.iterdir())
    assert cli.run([*verb, "bad.yaml"]) == 2
    text = sentence(capsys)
    assert text.startswith("palpate: bad.yaml")
    assert words in text
    assert sorted(home.iterdir()) == before


def test_the_scenes_are_listed_with_what_they_are(capsys):
    assert cli.run(["scene", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(
        p.stem for p in SHIPPED_SCENES.glob("*.yaml")
    )
    assert all(len(line) <= 80 for line in lines)
    assert any(line.startswith("vase         A vase of 100 mm") for line in lines)


def test_the_kinds_of_node_are_listed_and_described(capsys):
    assert cli.run(["node", "kinds"]) == 0
    assert capsys.readouterr().out.split() == list(list_kinds())
    assert cli.run(["node", "kinds", "planner"]) == 0
    text = capsys.readouterr().out
    assert "  subscribes /world  World" in text
    assert "  publishes  /contour/goal  ContourGoal" in text
    assert "  takes planner  string  default predicted" in text


def command_that(monkeypatch, error):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(cli.palpate_group, "main", fail)


def test_a_bug_shows_a_sentence_and_keeps_its_traceback(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    command_that(monkeypatch, ZeroDivisionError("by\nnothing"))
    assert cli.run(["run"]) == 3
    text = sentence(capsys)
    found = re.fullmatch(r"palpate: a bug: ZeroDivisionError: by nothing; .* in (\S+)\n", text)
    assert found is not None
    assert "Traceback" in Path(found[1]).read_text()


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (click.Abort(), 130, "interrupted"),
        (OSError(28, "No space left on device", "x.npz"), 2, "x.npz: No space left on device"),
        (InputError("f.yaml:3: wrong"), 2, "palpate: f.yaml:3: wrong"),
    ],
)
def test_every_other_failure_is_a_sentence_too(monkeypatch, capsys, error, code, words):
    command_that(monkeypatch, error)
    assert cli.run(["run"]) == code
    assert words in sentence(capsys)


def test_an_output_that_nobody_reads_is_no_failure():
    code = "from palpate.tools.cli.command_line import main; main(['scene', 'list'])"
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=write, stderr=subprocess.PIPE, timeout=300, check=False
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize(
    "streams",
    [">&-", "2>&-", "<&-", "<&- >&- 2>&-", "2>/dev/full", "2>&1 | true", ">/dev/null 2>&1 <&-"],
)
@pytest.mark.parametrize(("verb", "code"), [("scene list", 0), ("scene chekc", 2), ("", 2)])
def test_streams_that_are_closed_or_full_change_no_exit_code(streams, verb, code, home):
    call = f"{sys.executable} -P -m palpate {verb}"
    script = f"( {call} ; echo $? >code ) {streams}"
    subprocess.run(["bash", "-c", script], timeout=300, check=True, capture_output=True)
    assert int((home / "code").read_text()) == code


def test_an_output_that_cannot_be_written_is_a_sentence():
    call = f"{sys.executable} -P -m palpate scene list >/dev/full"
    done = subprocess.run(["bash", "-c", call], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (2, "palpate: the system: No space left on device\n")


@pytest.mark.parametrize("name", ["b\udcff", "é", "a\nb", "-x", "50%s 'a' \"b\""])
@pytest.mark.parametrize("coding", ["utf-8", "ascii"])
def test_a_scene_of_any_name_is_checked_and_told_in_any_terminal(name, coding, home):
    (home / os.fsencode(f"{name}.yaml").decode(errors="surrogateescape")).write_text(
        "object: {sphere: {radius: 30mm}}"
    )
    env = {**os.environ, "PYTHONIOENCODING": coding, "PYTHONPATH": ""}
    told = [sys.executable, "-P", "-m", "palpate", "scene", "check", "--", f"{name}.yaml"]
    done = subprocess.run(told, capture_output=True, env=env, timeout=300)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"can be explored" in done.stdout


def test_the_exit_code_of_a_verb_is_that_of_the_process(monkeypatch):
    monkeypatch.setattr(cli.palpate_group, "main", lambda *_, **__: 1)
    with pytest.raises(SystemExit) as caught:
        cli.main(["run"])
    assert caught.value.code == 1


def test_json_is_all_that_json_prints(monkeypatch, capsys, home):
    from palpate.launch.run import Run
    from palpate.nodes.runtime.composed import Ending
    from palpate.tools import exploration as play

    asked: list[bool] = []
    figures = {"status": "died", "reason": "the tracer fell", "missed": ["too coarse"]}

    def performed(plan, *, composed, display):
        asked.append(composed)
        ending = Ending(status="died", reason="the tracer fell")
        return Run(home, ending, figures, None, 3)

    monkeypatch.setattr("palpate.launch.perform", performed)
    monkeypatch.setattr("palpate.tools.report.write_report", lambda runs, path: None)
    plan: Any = SimpleNamespace(asked="a tolerance of 0.2 mm")
    assert play.perform_and_print(plan, composed=True, as_json=True, quiet=False) == 3
    assert json.loads(capsys.readouterr().out) == figures
    assert play.perform_and_print(plan, composed=False, as_json=False, quiet=True) == 3
    assert capsys.readouterr() == ("", "palpate: died: too coarse; the tracer fell\n")
    assert asked == [True, False]


def test_a_program_that_exits_from_within_is_no_success(monkeypatch, capsys):
    command_that(monkeypatch, SystemExit(0))
    assert cli.run(["run"]) == 3
    assert "called exit(0)" in sentence(capsys)


def test_a_scene_is_checked_and_told(capsys):
    assert cli.run(["scene", "check", "worn_sensor"]) == 0
    _, size, sensor, _, simulated, *effects = capsys.readouterr().out.splitlines()
    assert size.strip() == "can be explored; the object measures 60.0 x 52.0 x 90.0 mm"
    assert "16 x 16 taxels" in sensor
    assert "and 7 effects, in this order:" in simulated
    assert effects[0].split() == ["aim", "pose_error", *effects[0].split()[2:]]
    assert "sigma 0.0001 m, rotation 0.05 deg" in effects[0]


def test_a_calibration_is_written_and_told(write, home, capsys):
    write("s.yaml", "object: {superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}}")
    assert cli.run(["calibrate", "s.yaml", "--out", "found.yaml", "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "256 calibrated, 0 not reached, 0 not trusted" in out
    assert (home / "found.yaml").exists()
    assert cli.run(["calibrate", "s.yaml", "--out", "found.yaml"]) == 2
    assert sentence(capsys) == "palpate: found.yaml: exists already; it is not overwritten\n"


def test_an_effect_is_begun(home, capsys):
    assert cli.run(["init", "effect", "hum"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "  - hum:Hum"
    assert (home / "hum.py").exists()


def test_the_effects_are_listed(capsys):
    assert cli.run(["scene", "effects"]) == 0
    assert "\ngaussian_noise: Noise of the electronics" in capsys.readouterr().out


def test_a_word_that_is_none_of_a_few_is_refused_with_those(write, capsys):
    ball = "object: {superquadric: {size: [0.04, 0.04, 0.04], exponents: [1, 1]}}\n"
    write("s.yaml", ball + "effects:\n  - aperture: {reading: median}\n")
    assert cli.run(["scene", "check", "s.yaml"]) == 2
    assert "reading is 'median'; expected one of max, mean" in sentence(capsys)
