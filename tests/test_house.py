"""The repository as a thing to install: the wheel, the links, the start script."""

from __future__ import annotations

import importlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import pytest

import palpate

ROOT = Path(__file__).parent.parent
ROOMS = sorted(
    {path.stem for path in (ROOT / "palpate").glob("[a-z]*.py")} - {"output", "preloading", "reprs"}
)
IMPORT_ALL = """
import importlib, pathlib, sys
home = pathlib.Path(sys.argv[1])
names = sorted(
    ".".join(path.relative_to(home).with_suffix("").parts).removesuffix(".__init__")
    for path in (home / "palpate").rglob("*.py")
    if path.name != "__main__.py" and "scenes" not in path.parts
)
for name in names:
    found = importlib.import_module(name)
    assert pathlib.Path(found.__file__).is_relative_to(home), found.__file__
print(len(names))
"""


def run(*command: str | Path, **env: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, **env},
    )


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Palpate installed from its wheel, apart from the checkout."""
    work = tmp_path_factory.mktemp("wheel")
    source, target = work / "source", work / "target"
    skipped = shutil.ignore_patterns(".*", "build", "runs", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, source, symlinks=True, ignore=skipped)
    pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
    options = ("--no-deps", "--no-build-isolation", "--no-index")
    built = run(*pip, "wheel", *options, "--wheel-dir", work, source)
    assert built.returncode == 0, built.stderr
    (wheel,) = work.glob("palpate-*.whl")
    done = run(*pip, "install", "--no-deps", "--no-index", "--target", target, wheel)
    assert done.returncode == 0, done.stderr
    return target


@pytest.mark.slow
def test_every_module_of_the_wheel_can_be_imported(installed):
    done = run(sys.executable, "-P", "-c", IMPORT_ALL, installed, PYTHONPATH=str(installed))
    assert done.returncode == 0, done.stderr
    layers = ("core", "messages", "nodes", "launch", "tools", "bench")
    here = sum(
        "scenes" not in path.parts for layer in layers for path in (ROOT / layer).rglob("*.py")
    )
    public = len([path for path in (ROOT / "palpate").glob("*.py") if path.name != "__main__.py"])
    assert int(done.stdout) == here + public


@pytest.mark.slow
def test_the_wheel_has_the_scenes_the_launch_file_and_the_type_marker(installed):
    names = {path.name for path in (ROOT / "scenes").iterdir() if path.suffix in (".yaml", ".ply")}
    assert len(names) >= 7
    for name in names:
        assert (installed / "palpate/launch/scenes" / name).is_file()
    assert (installed / "palpate/launch/explore.yaml").is_file()
    assert (installed / "palpate/py.typed").is_file()


@pytest.mark.slow
def test_the_wheel_installs_nothing_but_palpate(installed):
    tops = {path.name for path in installed.iterdir()}
    assert {name for name in tops if not re.match(r"palpate|bin$", name)} == set()


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert palpate.__version__ == project["version"]
    assert f"\nversion: {palpate.__version__}\n" in (ROOT / "CITATION.cff").read_text()


def test_the_folders_are_linked_under_the_import_name():
    for layer in ("core", "messages", "nodes", "launch", "tools", "bench"):
        assert (ROOT / "palpate" / layer).resolve() == ROOT / layer
    assert (ROOT / "launch" / "scenes").resolve() == ROOT / "scenes"


def test_the_top_module_offers_its_names_and_no_others():
    assert palpate.load_scene("sphere").name == "sphere"
    assert callable(palpate.explore)
    assert {name for name in dir(palpate) if not name.startswith("__")} == {
        *ROOMS,
        "ContactPoints",
        "GeneralSolid",
        "LatticeSolid",
        "MeshSolid",
        "Run",
        "Scene",
        "Solid",
        "explore",
        "load",
        "load_run",
        "load_scene",
        "open_recording",
        "read_frames",
        "rebuild_general",
        "reconstruct",
        "save",
        "surface_patch",
    }
    with pytest.raises(AttributeError, match="exlpore"):
        palpate.exlpore  # noqa: B018


@pytest.mark.parametrize("room", ROOMS)
def test_public_rooms_export_names_of_their_own(room):
    names: dict[str, object] = {}
    exec(f"from palpate.{room} import *", names)
    module = importlib.import_module(f"palpate.{room}")
    exported = {name for name in vars(module) if not name.startswith("_")}
    assert exported == names.keys() - {"__builtins__"}
    assert not [name for name in exported if isinstance(getattr(module, name), types.ModuleType)]


def test_every_name_of_palpate_is_there_for_import_star_and_help():
    names: dict[str, object] = {}
    exec("from palpate import *", names)
    assert set(palpate.__all__) == names.keys() - {"__builtins__"}
    assert set(palpate.__all__) <= set(dir(palpate))


def test_a_folder_called_palpate_does_not_hide_the_package(tmp_path):
    (tmp_path / "palpate").symlink_to(ROOT)
    code = "import os; os.chdir(os.sys.argv[1]); import palpate; print(palpate.explore.__name__)"
    done = run(sys.executable, "-c", code, tmp_path)
    assert (done.stdout, done.stderr) == ("explore\n", "")


def test_importing_palpate_imports_nothing_heavy():
    code = "import palpate, sys; print(sorted({'numpy', 'scipy', 'click'} & set(sys.modules)))"
    assert run(sys.executable, "-c", code).stdout == "[]\n"


def test_the_pins_have_no_address_and_cover_what_is_required():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = {re.split("==", line)[0].replace("_", "-").lower() for line in lines}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["dev"], *extras["docs"], *extras["sweep"]]
    assert all(re.fullmatch(r"[a-z0-9.-]+==[a-z0-9.]+( ; .+)?", line) for line in lines)
    assert {re.split(r"[>=;\[ ]", name)[0].replace("_", "-").lower() for name in wanted} <= pinned


@pytest.fixture
def clone(tmp_path):
    """The start script in a folder of its own, with an environment that counts as set up."""
    for name in ("go", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def set_up(clone: Path, palpate_script: str) -> None:
    """Pretend that ``./go`` has set up the environment already."""
    folder = clone / ".venv" / "bin"
    folder.mkdir(parents=True)
    (folder / "python").symlink_to(sys.executable)
    script = folder / "palpate"
    script.write_text(f"#!/bin/sh\n{palpate_script}\n")
    script.chmod(0o755)
    stamp = run("sh", "-c", f"cd {clone}; cat pyproject.toml constraints.txt | cksum").stdout
    (clone / ".venv" / ".stamp").write_text(stamp)


def test_the_start_script_explores_the_vase_unless_told_otherwise(clone):
    set_up(clone, 'echo "$@"')
    assert run(clone / "go").stdout == "run vase\n"
    assert run(clone / "go", "scene", "list").stdout == "scene list\n"


def test_a_package_called_launch_on_the_path_does_not_disturb_the_start_script(clone):
    (clone / "ros" / "launch").mkdir(parents=True)
    (clone / "ros" / "launch" / "__init__.py").write_text("raise SystemExit('the wrong launch')")
    set_up(clone, f"exec {sys.executable} -P -c 'import launch'")
    done = run(clone / "go", "--version", PYTHONPATH=str(clone / "ros"))
    assert "the wrong launch" not in done.stderr
    assert "No module named 'launch'" in done.stderr


def stand_in(folder: Path, name: str, script: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


def path_without_python(clone: Path) -> Path:
    """A folder of programs that holds what the script needs, and no Python."""
    folder = clone / "programs"
    folder.mkdir()
    for name in ("sh", "cat", "cksum", "env", "grep", "rm", "dirname"):
        found = shutil.which(name)
        assert found is not None
        (folder / name).symlink_to(found)
    return folder


def test_without_a_new_enough_python_the_start_script_says_so(clone):
    programs = path_without_python(clone)
    stand_in(programs, "python3", "exit 1")
    done = run(clone / "go", PATH=str(programs))
    assert done.returncode == 2
    assert done.stderr.startswith("palpate: needs Python 3.11 or newer")
    assert done.stderr.count("\n") == 1


def test_a_python_that_does_not_run_is_passed_over_and_a_missing_venv_is_reported(clone):
    programs = path_without_python(clone)
    # A version manager's answer to a name for which it has no version.
    stand_in(programs, "python3", "echo 'no version is set' >&2; exit 127")
    # Runs everything but venv, as Debian's Python does without python3-venv.
    no_venv = f'[ "$1 $2" = "-m venv" ] && exit 1\nexec {sys.executable} "$@"'
    stand_in(programs, "python3.12", no_venv)
    stand_in(programs, "python3.11", "exit 1")
    done = run(clone / "go", PATH=str(programs))
    assert done.returncode == 2
    assert "Python's venv is missing; on Debian or Ubuntu" in done.stderr
    assert not (clone / ".venv").exists()


# Notes what it is asked and leaves an environment behind, as uv would.
UV = """echo "$1 $2" >> {clone}/uv.log
[ "$1" = venv ] || exit 0
for place; do :; done  # the last argument
mkdir -p "$place/bin"
printf '#!/bin/sh\\nexit 0\\n' > "$place/bin/palpate"
chmod +x "$place/bin/palpate"
ln -s {python} "$place/bin/python\""""


def without_pip_settings() -> dict[str, str]:
    """An environment in which pip has no index of its own."""
    env = {key: value for key, value in os.environ.items() if not key.startswith("PIP_")}
    return {**env, "PIP_CONFIG_FILE": os.devnull}


@pytest.mark.parametrize(
    ("setting", "called"), [({}, True), ({"PIP_INDEX_URL": "http://127.0.0.1:9/"}, False)]
)
def test_uv_sets_up_unless_pip_has_an_index_of_its_own(clone, setting, called):
    programs = path_without_python(clone)
    (programs / "mkdir").symlink_to(shutil.which("mkdir") or "")
    (programs / "chmod").symlink_to(shutil.which("chmod") or "")
    (programs / "ln").symlink_to(shutil.which("ln") or "")
    stand_in(programs, "uv", UV.format(python=sys.executable, clone=clone))
    # Without uv the next step would be venv, which fails here so that nothing is installed.
    stand_in(programs, "python3", f'[ "$1 $2" = "-m venv" ] && exit 1\nexec {sys.executable} "$@"')

    done = subprocess.run(
        [str(clone / "go"), "--version"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**without_pip_settings(), **setting, "PATH": str(programs)},
    )

    assert done.returncode == (0 if called else 2), done.stderr
    assert (clone / "uv.log").exists() is called
    if called:
        assert (clone / "uv.log").read_text() == "venv --quiet\npip install\n"
        again = run(clone / "go", "--version", PATH=str(programs))
        assert again.stderr == ""
