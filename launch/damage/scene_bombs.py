"""Scene files that were made to hurt, and the folder of files that they name."""

from __future__ import annotations

import os
from functools import cache
from itertools import pairwise
from pathlib import Path

from palpate.launch.damage.mesh_samples import sound_meshes
from palpate.launch.damage.scene_values import BALL, OBJECT, scene_values

NAMES = (
    "../outside.ply",
    "..",
    ".",
    "/etc/passwd",
    "//etc/passwd",
    "/dev/zero",
    "/proc/self/environ",
    "x/../../outside.ply",
    "passwd.ply",
    "loop.ply",
    "folder.ply",
    "pipe.ply",
    "empty.ply",
    "none.ply",
    "mesh.PLY",
    "mesh.ply/..",
    "a\\0b.ply",
    "a\\nb.ply",
    "\\ud800.ply",
    "~/mesh.ply",
    "file:///etc/passwd",
    "a" * 5000 + ".ply",
    "a/" * 3000 + "b.ply",
    "scene.yaml",
    "",
)
"""Files that a scene may name and should not."""
RAW = (b"", b"\0", b"\xff\xfeo\0b\0", b"object: \xff\n", b"object: \0\n", b"\x1f\x8b\x08\0")
"""Files that are no text."""


def fill_folder(folder: Path) -> None:
    """Put what scenes name into the folder where they lie."""
    (folder / "mesh.ply").write_bytes(sound_meshes()["little.ply"])
    (folder / "empty.ply").touch()
    (folder / "folder.ply").mkdir()
    (folder / "passwd.ply").symlink_to("/etc/passwd")
    (folder / "loop.ply").symlink_to(folder / "loop.ply")
    os.mkfifo(folder / "pipe.ply")
    (folder / "gains.yaml").write_text(_calibration(16))


@cache
def scene_bombs() -> list[bytes]:
    """Scenes, as the bytes of their files."""
    texts = (*_paths(), *_forms(), *scene_values())
    return [*(one.encode(errors="surrogatepass") for one in texts), *RAW]


def _paths() -> list[str]:
    meshes = [f'object: {{mesh: {{file: "{name}", unit: mm}}}}\n' for name in NAMES]
    return meshes + [f'{OBJECT}sensor: {{calibration: "{name}"}}\n' for name in NAMES]


def _forms() -> list[str]:
    """What is wrong with the text itself."""
    laughs = "a: &a [x, x, x, x, x, x, x, x, x]\n"
    for old, new in pairwise("abcdefghi"):
        laughs += f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n"
    return [
        laughs,
        "object: &o {o: *o}\n",
        f"base: &b {{{BALL}}}\nobject: {{<<: *b}}\n",
        f"object: {{<<: {{{BALL}}}}}\n",
        "object: !!python/object/apply:os.system ['true']\n",
        "object: !!binary aGVsbG8=\n",
        "object: !own {a: 1}\n",
        "%TAG ! tag:x,2000:\n---\nobject: 1\n",
        "%YAML 9.9\n---\nobject: 1\n",
        OBJECT + "---\n" + OBJECT,
        OBJECT + "...\n" + OBJECT,
        "object: " + "[" * 100_000,
        "object: " + "{a: " * 50_000,
        "".join("  " * i + "a:\n" for i in range(400)),
        "- " * 100_000,
        "? " * 100_000,
        "object: [" + "1," * 120_000 + "]\n",
        "object: {" + "".join(f"k{i}: 1, " for i in range(20_000)) + "}\n",
        "k" * 200_000 + ": 1\n",
        '"' + "k" * 200_000 + '": 1\n',
        'object: "' + "\\x41" * 60_000 + '"\n',
        "object: |\n" + "  x\n" * 60_000,
        "object: " + "a b " * 60_000,
        "# x\n" * 60_000,
        " " * 250_000,
        "\n" * 250_000,
        "\t" * 1000 + OBJECT,
        OBJECT + "object: 1\n",
        OBJECT.replace("size", "size: [1, 1, 1], size"),
        "\ufeff" + OBJECT,
        OBJECT + "\ufeff",
        OBJECT.replace("\n", "\r"),
        OBJECT + "\u0085seed: 1\u2028",
        OBJECT + '"\\ud800": 1\n',
        OBJECT + '"": 1\n',
        OBJECT + "? [1, 2]\n: 3\n",
        OBJECT + ".inf: 1\n",
        OBJECT + "x" * 300_000,
    ]


def _calibration(side: int) -> str:
    gain = [[1.0] * side] * side
    offset = [[0.0] * side] * side
    return f"gain: {gain}\noffset: {offset}\nsound_speed: 1000.0\nnoise: 1.0e-5\n"
