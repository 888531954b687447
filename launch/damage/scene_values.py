"""Scenes that say what no scene can mean: sizes, seeds, trees and names beyond all bounds."""

from __future__ import annotations

BALL = "superquadric: {size: [0.03, 0.03, 0.03], exponents: [1.0, 1.0]}"
OBJECT = f"object: {{{BALL}}}\n"
SEEDS = ("0x" + "f" * 20_000, "9" * 4000, "9" * 5000, "1e400", "-1", "2001-01-01", "1:30", ".nan")
SIZES = (".inf", ".nan", "-1", "1e308", "1e-300", "'1'")
POWERS = ("0.02", "2.0", "1e-9", "1e9")


def scene_values() -> list[str]:
    """What is wrong with what it says."""
    return [
        *(f"{OBJECT}seed: {seed}\n" for seed in SEEDS),
        f"object: {{{BALL.replace('0.03', '0x' + 'f' * 400, 1)}}}\n",
        *(f"object: {{{BALL.replace('0.03', size)}}}\n" for size in SIZES),
        *(f"object: {{{BALL.replace('1.0', power)}}}\n" for power in POWERS),
        f"object: {{{BALL}, pose: {{position: [1e308, 1e308, 1e308]}}}}\n",
        f"object: {{{BALL}, lattice: [{', '.join(['{scale: 1.0}'] * 64)}]}}\n",
        f"object: {{{BALL}, lattice: [{', '.join(['{turn: 180}', '{scale: 0.1}'] * 8)}]}}\n",
        *_booleans(),
        "object: {polyhedron: {vertices: [" + "[0, 0, 0]," * 900 + "], faces: [[0, 1, 2]]}}\n",
        "object: {mesh: {file: mesh.ply, unit: mm}, " + BALL + "}\n",
        "object: {mesh: {file: mesh.ply, unit: ly}}\n",
        "object: {mesh: mesh.ply}\n",
        "object: {mesh: {file: [mesh.ply], unit: mm}}\n",
        OBJECT + "sensor: {calibration: gains.yaml}\n",
        OBJECT + "sensor: {calibration: 7}\n",
        OBJECT + "sensor: {rows: 64, cols: 64, pitch: 0.0002}\n",
        OBJECT + "effects: [" + "gaussian_noise, " * 1500 + "]\n",
        OBJECT + "effects: {gaussian_noise: 1}\n",
        OBJECT + "effects: [no_such_module_of_mine:Effect]\n",
        OBJECT + "effects: ['.:Effect', ':', 'a:', '..a:b']\n",
        OBJECT + "explore: {planner: 7}\n",
        OBJECT + "explore: {planner: no_such_module_of_mine:Planner}\n",
        OBJECT + "explore: {settings: [1]}\n",
        OBJECT + "explore: {axis: [0, 0, 0]}\n",
        OBJECT + "explore: {tolerance: .nan}\n",
        OBJECT + "explore: {" + ", ".join(f"a{i}: $(out)" for i in range(500)) + "}\n",
        "$(scene): 1\n",
        "object:\n",
        "object: $(scene)\n",
    ]


def _booleans() -> list[str]:
    small = BALL.replace("0.03", "0.01")
    row = ", ".join(f"{{{small}, pose: {{position: [0, 0, {i / 1000}]}}}}" for i in range(30))
    wide = ", ".join([f"{{union: [{row}]}}"] * 30)
    deep = BALL
    for _ in range(6):
        deep = f"complement: {{{deep}}}"
    trees = (
        f"union: [{row}]",
        f"union: [{wide}]",
        deep,
        f"intersection: [{{{BALL}}}, {{half_space: {{normal: [0, 0, 0]}}}}]",
    )
    return [f"object: {{boolean: {{{tree}}}}}\n" for tree in trees]
