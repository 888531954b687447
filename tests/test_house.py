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
from typing import Any

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
    module = importlib.import_module(name)
    assert pathlib.Path(module.__file__).is_relative_to(home), module.__file__
print(len(names))
"""


def run(*command: str | Path, **env: str) -> subprocess.CompletedProcess[str]:
    options: dict[str, Any] = {"capture_output": True, "text": True, "timeout": 300}
    arguments = [str(part) for part in command]
    return subprocess.run(arguments, check=False, env={**os.environ, **env}, **options)


@pytest.fixture
def installed(tmp_path):
    """Folder with palpate installed from its wheel."""
    work, source, target = tmp_path, tmp_path / "source", tmp_path / "target"
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
def test_wheel_installs_palpate_alone_with_modules_scenes_and_type_marker(installed):
    done = run(sys.executable, "-P", "-c", IMPORT_ALL, installed, PYTHONPATH=str(installed))
    assert done.returncode == 0, done.stderr
    layers = ("core", "messages", "nodes", "launch", "tools", "bench")
    own = [path for layer in layers for path in (ROOT / layer).rglob("*.py")]
    public = [path for path in (ROOT / "palpate").glob("*.py") if path.name != "__main__.py"]
    assert int(done.stdout) == len([*public, *(p for p in own if "scenes" not in p.parts)])
    names = {path.name for path in (ROOT / "scenes").iterdir() if path.suffix in (".yaml", ".ply")}
    assert len(names) >= 7
    files = ("launch/explore.yaml", "py.typed", *(f"launch/scenes/{name}" for name in names))
    assert all((installed / "palpate" / file).is_file() for file in files)
    tops = {path.name for path in installed.iterdir()}
    assert {name for name in tops if not re.match(r"palpate|bin$", name)} == set()


def test_version_is_the_same_in_all_files_and_pins_cover_all_requirements():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert palpate.__version__ == project["version"]
    assert f"\nversion: {palpate.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = {re.split("==", line)[0].replace("_", "-").lower() for line in lines}
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["dev"], *extras["docs"], *extras["sweep"]]
    assert all(re.fullmatch(r"[a-z0-9.-]+==[a-z0-9.]+( ; .+)?", line) for line in lines)
    assert {re.split(r"[>=;\[ ]", name)[0].replace("_", "-").lower() for name in wanted} <= pinned


def test_folders_are_linked_into_the_package():
    for layer in ("core", "messages", "nodes", "launch", "tools", "bench"):
        assert (ROOT / "palpate" / layer).resolve() == ROOT / layer
    assert (ROOT / "launch" / "scenes").resolve() == ROOT / "scenes"


def test_top_module_exports_only_its_names():
    assert palpate.load_scene("sphere").name == "sphere"
    assert callable(palpate.explore)
    assert {name for name in dir(palpate) if not name.startswith("__")} == {
        *ROOMS,
        *("ContactPoints", "GeneralSolid", "LatticeSolid", "MeshSolid", "Run", "Scene", "Solid"),
        *("explore", "load", "load_run", "load_scene", "open_recording", "read_frames"),
        *("rebuild_general", "reconstruct", "save", "surface_patch"),
    }
    with pytest.raises(AttributeError, match="exlpore"):
        palpate.exlpore  # noqa: B018
    names: dict[str, object] = {}
    exec("from palpate import *", names)
    assert set(palpate.__all__) == names.keys() - {"__builtins__"}
    assert set(palpate.__all__) <= set(dir(palpate))


@pytest.mark.parametrize("room", ROOMS)
def test_public_room_exports_no_modules(room):
    names: dict[str, object] = {}
    exec(f"from palpate.{room} import *", names)
    module = importlib.import_module(f"palpate.{room}")
    exported = {name for name in vars(module) if not name.startswith("_")}
    assert exported == names.keys() - {"__builtins__"}
    assert not [name for name in exported if isinstance(getattr(module, name), types.ModuleType)]


def test_palpate_is_not_hidden_by_a_folder_and_imports_nothing_heavy(tmp_path):
    (tmp_path / "palpate").symlink_to(ROOT)
    code = (
        "import os, sys; os.chdir(sys.argv[1]); import palpate; heavy = 'numpy', 'scipy', 'click'"
    )
    code += "; print({*heavy} & {*sys.modules}, palpate.explore.__name__)"
    done = run(sys.executable, "-c", code, tmp_path)
    assert (done.stdout, done.stderr) == ("set() explore\n", "")


@pytest.fixture
def clone(tmp_path):
    """A folder with the start script and the files that it reads."""
    for name in ("go", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def test_start_script_explores_the_vase_by_default_and_ignores_another_launch(clone):
    folder = clone / ".venv" / "bin"  # of an environment that it takes for complete
    folder.mkdir(parents=True)
    (folder / "python").symlink_to(sys.executable)
    stamp = run("sh", "-c", f"cd {clone}; cat pyproject.toml constraints.txt | cksum").stdout
    (clone / ".venv" / ".stamp").write_text(stamp)
    write_program(folder, "palpate", 'echo "$@"')
    assert run(clone / "go").stdout == "run vase\n"
    assert run(clone / "go", "scene", "list").stdout == "scene list\n"
    (clone / "ros" / "launch").mkdir(parents=True)
    (clone / "ros" / "launch" / "__init__.py").write_text("raise SystemExit('the wrong launch')")
    write_program(folder, "palpate", f"exec {sys.executable} -P -c 'import launch'")
    done = run(clone / "go", "--version", PYTHONPATH=str(clone / "ros"))
    assert "the wrong launch" not in done.stderr
    assert "No module named 'launch'" in done.stderr


NO_VENV = f'[ "$1 $2" = "-m venv" ] && exit 1\nexec {sys.executable} "$@"'


def write_program(folder: Path, name: str, script: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


@pytest.fixture
def programs(clone):
    """A folder with the programs that the start script needs, without Python."""
    folder = clone / "programs"
    folder.mkdir()
    for name in ("sh", "cat", "cksum", "env", "grep", "rm", "dirname", "mkdir", "chmod", "ln"):
        (folder / name).symlink_to(str(shutil.which(name)))
    return folder


def test_missing_python_or_venv_is_reported(clone, programs):
    write_program(programs, "python3", "exit 1")
    done = run(clone / "go", PATH=str(programs))
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith("palpate: needs Python 3.11 or newer")
    # As a version manager without a version for this name.
    write_program(programs, "python3", "echo 'no version is set' >&2; exit 127")
    # Runs all modules but venv, as Debian's Python without python3-venv.
    write_program(programs, "python3.12", NO_VENV)
    write_program(programs, "python3.11", "exit 1")
    done = run(clone / "go", PATH=str(programs))
    assert done.returncode == 2
    assert "Python's venv is missing; on Debian or Ubuntu" in done.stderr
    assert not (clone / ".venv").exists()


# Logs its commands and creates an environment, as uv does.
UV = """echo "$1 $2" >> {clone}/uv.log
[ "$1" = venv ] || exit 0
for place; do :; done  # the last argument
mkdir -p "$place/bin"
printf '#!/bin/sh\\nexit 0\\n' > "$place/bin/palpate"
chmod +x "$place/bin/palpate"
ln -s {python} "$place/bin/python\""""


@pytest.mark.parametrize(
    ("setting", "is_called"), [({}, True), ({"PIP_INDEX_URL": "http://127.0.0.1:9/"}, False)]
)
def test_uv_is_used_unless_pip_has_its_own_index(clone, programs, setting, is_called, monkeypatch):
    write_program(programs, "uv", UV.format(python=sys.executable, clone=clone))
    # Without uv the script would use venv, which fails here so that nothing is installed.
    write_program(programs, "python3", NO_VENV)
    for name in [name for name in os.environ if name.startswith("PIP_")]:
        monkeypatch.delenv(name)
    options = {"PIP_CONFIG_FILE": os.devnull, **setting, "PATH": str(programs)}
    done = run(clone / "go", "--version", **options)

    assert done.returncode == (0 if is_called else 2), done.stderr
    assert (clone / "uv.log").exists() is is_called
    if is_called:
        assert (clone / "uv.log").read_text() == "venv --quiet\npip install\n"
        again = run(clone / "go", "--version", PATH=str(programs))
        assert again.stderr == ""
