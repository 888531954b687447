"""The command line: exit codes, one sentence for each failure, streams and scenes of any kind."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
import trimesh

from palpate.launch.files.source_map import InputError
from palpate.launch.scene import SHIPPED_SCENES
from palpate.tools.cli.command_line import main, palpate_group

pytestmark = pytest.mark.usefixtures("here")
PALPATE = f"{sys.executable} -P -m palpate"


def python(code, *arguments, **how):
    """A program in an interpreter of its own."""
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, timeout=300, **{"capture_output": True, **how})


def test_main_exits_with_code_of_the_command(monkeypatch, capsys):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    monkeypatch.delenv("OMP_NUM_THREADS")
    monkeypatch.setattr("signal.signal", lambda *_: None)
    for words, code in ((["--version"], 0), (["lanch"], 2)):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == code
    assert re.fullmatch(r"palpate, version \d+\.\d+\.\d+\n", capsys.readouterr().out)
    # Linear algebra has one thread unless the user wants more.
    assert (os.environ["OPENBLAS_NUM_THREADS"], os.environ["OMP_NUM_THREADS"]) == ("3", "1")


def test_help_lists_commands_without_importing_them():
    code = "import sys; from palpate.tools.cli.command_line import run; run(['--help'])"
    done = python(f"{code}; print(*sys.modules)", text=True, check=True)
    *text, modules = done.stdout.splitlines()
    assert len(text) <= 36
    for verb in ("run", "launch", "replay", "bag", "scene", "node", "topic", "doctor"):
        assert any(line.startswith(f"  {verb} ") for line in text)
    assert not {"numpy", "msgspec", "rich", "palpate.tools.cli.launching"} & {*modules.split()}


NO_RECORDING = "x.mcap: the recording does not exist"


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        ("lanch", "there is no command 'lanch'; did you mean 'launch'? (see palpate --help)"),
        ("run --sed 3", "No such option"),
        ("run vase --seed -3", "-3 is not in the range"),
        ("run vaes", "there is no scene 'vaes'; did you mean 'vase'?"),
        ("run none.stl", "none.stl: the scene does not exist; a scene is a YAML file, or a mesh"),
        ("run vase --set x", "--set x: must look like planner.tolerance=0.2e-3"),
        ("launch", "Missing argument 'FILE'"),
        ("launch explore.yaml scen:=box", "has no argument 'scen'; did you mean 'scene'"),
        ("replay", "Missing argument 'BAG'"),
        ("bag diff x.mcap", "Missing argument 'B'"),
        ("bag info x.mcap", NO_RECORDING),
        ("bag export x.mcap -o y", "Missing option '--format'"),
        ("bag export x.mcap -o y --format csv", NO_RECORDING),
        ("topic ecko", "there is no command 'ecko'; did you mean 'echo'? (see palpate topic"),
        ("topic echo", "Missing argument 'TOPIC'"),
        ("topic hz", "name at least one topic, or choose --all of them, not both"),
        ("topic hz /a --window 1", "1 is not in the range"),
        ("calibrate", "Missing argument 'SCENE'"),
        ("--completion csh", "'csh' is not one of 'bash', 'zsh', 'fish'"),
    ],
)
def test_wrong_command_lines_are_refused_in_one_sentence(here, refusal, words, fragment):
    assert fragment in refusal(words)
    assert [*here.iterdir()] == []


ONES = "object: {superquadric: {size: [1, 1, 1], exponents: [1, 1]}}\n"
BAD_SCENES = {
    "": "is empty",
    ONES.replace("1, 1, 1", "1, -1, 1"): "size[1] is -1; expected number > 0.0",
    f"{ONES}effects:\n- drift: {{rate: 9}}": "rate is 9 m/sqrt(s); expected 0 to 0.0001 m/sqrt(s)",
    f"{ONES}effects: [aperture: {{reading: median}}]": "'median'; expected one of max, mean",
    f"{ONES}sensor: {{rows: 3}}": "sensor.rows is 3; expected whole number >= 4",
    f"{ONES}sensor: {{pad: {{thickness: 0.001}}}}": "m, to be pressed by 0.00",
    "object: {mesh: {file: open.off, unit: mm}}": "bounds no solid",
}


@pytest.mark.parametrize("text", BAD_SCENES)
def test_bad_scenes_are_refused_and_leave_nothing(write, here, refusal, text):
    box = trimesh.creation.box([50.0, 40.0, 30.0])
    box.update_faces([True] * 2 + [False] * 10)
    box.export("open.off")
    write("bad.yaml", text)
    before = sorted(here.iterdir())
    for verb in ("run", "run --json", "scene check"):
        message = refusal(verb, "bad.yaml")
        assert message.startswith("palpate: bad.yaml") and BAD_SCENES[text] in message
    assert sorted(here.iterdir()) == before


def test_scenes_are_listed_and_checked(call):
    lines = call("scene list").out.splitlines()
    assert [line.split()[0] for line in lines] == sorted(
        p.stem for p in SHIPPED_SCENES.glob("*.yaml")
    )
    assert any(line.startswith("vase         A vase of 100 mm") for line in lines)
    _, size, sensor, _, simulated, *_ = call("scene check worn_sensor").out.splitlines()
    assert size.strip() == "can be explored; the object measures 60.0 x 52.0 x 90.0 mm"
    assert "16 x 16 taxels" in sensor and "and 7 effects, in this order:" in simulated
    assert "\ngaussian_noise: Noise of the electronics" in call("scene effects").out


def test_repaired_mesh_is_explored_and_repairs_are_printed(call, performed):
    box = trimesh.creation.box([0.06, 0.05, 0.04]).subdivide().subdivide().subdivide().subdivide()
    box.update_faces([False] + [True] * (len(box.faces) - 1))
    box.export("box.stl")
    result = call("run box.stl --composed --unit m --out run")
    assert result.err.startswith("mesh       box.stl: 1 hole of up to 4.5 mm closed\nasked ")
    assert "unit: m" in performed[0][0].about["scene"]
    for how, repairs in (
        ("", "\nmesh       box.stl: taken to be in m, 60 x 50 x 40 mm; 1 hole"),
        ("--unit m", "the object measures 60.0 x 50.0 x 40.0 mm"),
        ("--size 120mm", "the object measures 120.0 x 100.0 x 80.0 mm"),
    ):
        assert repairs in call(f"scene check box.stl {how}").out


def test_json_is_all_that_json_prints(call, performed):
    code, out, _ = call("run sphere --composed --json --out a")
    assert (code, json.loads(out)["reason"]) == (3, "the tracer fell")
    result = call("run sphere --quiet --out b")
    assert (result.code, result.out) == (3, "")
    assert result.err.splitlines()[-1] == "palpate: died: too coarse; the tracer fell"
    assert "palpate: no report.html: " in result.err  # there is no run to report


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (click.Abort(), 130, "interrupted"),
        (OSError(28, "No space left on device", "x.npz"), 2, "x.npz: No space left on device"),
        (OSError(24, "Too many"), 2, "the system allows too few open files"),
        (InputError("f.yaml:3: wrong"), 2, "palpate: f.yaml:3: wrong"),
        (UnicodeEncodeError("ascii", "é", 0, 1, "no"), 2, "'é' is no text in ascii; give the"),
        (SystemExit(0), 3, "called exit(0)"),
        (ZeroDivisionError("by\nnothing"), 3, "a bug: ZeroDivisionError: by nothing; "),
    ],
)
def test_every_failure_is_a_sentence_and_an_exit_code(call, tmp_path, monkeypatch, error, code,
                                                      words):  # fmt: skip
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(palpate_group, "main", fail)
    result = call("run")
    assert (result.code, result.out, result.err.count("\n")) == (code, "", 1)
    assert words in result.err and "Traceback" not in result.err
    if "a bug" in words:
        (place,) = re.findall(r"the traceback is in (\S+)\n", result.err)
        assert "Traceback" in Path(place).read_text()


@pytest.mark.parametrize(
    ("streams", "verb", "code"),
    [
        (">&-", "scene list", 0),
        ("2>&-", "scene chekc", 2),
        ("<&- >&- 2>&-", "scene list", 0),
        ("2>/dev/full", "", 2),
        ("2>&1 | true", "scene list", 0),
        (">/dev/null 2>&1 <&-", "scene chekc", 2),
    ],
)
def test_closed_or_full_streams_change_no_exit_code(streams, verb, code, here):
    script = f"( {PALPATE} {verb} ; echo $? >code ) {streams}"
    subprocess.run(["bash", "-c", script], timeout=300, check=True, capture_output=True)
    assert int((here / "code").read_text()) == code


def test_output_that_cannot_be_written_is_a_sentence():
    call = f"{PALPATE} scene list >/dev/full"
    done = subprocess.run(["bash", "-c", call], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (2, "palpate: the system: No space left on device\n")
    read, write = os.pipe()
    os.close(read)  # nobody reads what is written
    code = "from palpate.tools.cli.command_line import main; main(['scene', 'list'])"
    done = python(code, capture_output=False, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


CHECK_ALL = """
import os, sys
from palpate.tools.cli.command_line import main
for name in sorted(os.listdir()):
    try:
        main(["scene", "check", "--", name])
    except SystemExit as ended:
        assert ended.code == 0, name
"""


@pytest.mark.parametrize("coding", ["utf-8", "ascii"])
def test_scenes_of_any_name_are_checked_in_any_terminal(coding, here):
    names = ["b\udcff", "é", "a\nb", "-x", "50%s 'a' \"b\""]
    for name in names:
        path = here / os.fsencode(f"{name}.yaml").decode(errors="surrogateescape")
        path.write_text("object: {sphere: {radius: 30mm}}")
    done = python(CHECK_ALL, env={**os.environ, "PYTHONIOENCODING": coding})
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.count(b"can be explored") == len(names)


@pytest.mark.slow
def test_calibration_is_written_and_not_overwritten(write, call, refusal):
    write("s.yaml", ONES.replace("1, 1, 1", "0.04, 0.04, 0.04"))
    code, out, err = call("calibrate s.yaml --out found.yaml --quiet")
    assert (code, err) == (0, "") and "256 calibrated, 0 not reached, 0 not trusted" in out
    message = "palpate: found.yaml: exists already; it is not overwritten\n"
    assert refusal("calibrate s.yaml --out found.yaml") == message
