"""Plain words are held: the check finds what it is for, and the product has none of it."""

from __future__ import annotations

import pytest

from dev.plain import FOLDERS, ROOT, faults_of, plain_faults


@pytest.mark.parametrize(
    ("source", "texts"),
    [
        ("GAIN = 0.5", ["the number GAIN stands at module level"]),
        ("NEAR: float = 2.0 * LEAST", ["the number NEAR stands at module level"]),
        ("FEW, UNSURE = 3, math.radians(0.25)", ["FEW stands", "UNSURE stands"]),
        ("GRID = np.linspace(0.0, 1.0, 9)", ["the number GRID stands"]),
        ("NAMES = ('a', 'b')\nIS_FAST = True\nX = Settings(gain=2.0)", []),
        ("def f(way: float) -> float:\n    return way", ["the name 'way' does not say"]),
        ("def f(a):\n    found = a\n    return found", ["the name 'found' does not say"]),
        ("def f(a):\n    return [one for one in a]", []),  # it lives for a line
        ("class A:\n    told: str", []),
    ],
)
def test_check_finds_numbers_and_empty_names(source, texts):
    found = [fault.text for fault in faults_of("a.py", source)]
    assert len(found) == len(texts) and all(map(str.__contains__, found, texts))


def test_exceptions_are_named_and_still_needed():
    assert not list(faults_of("a.py", "KIND = 7", ["KIND"]))
    [fault] = faults_of("a.py", "KIND = 'b'", ["KIND"])
    assert str(fault) == "a.py:1: dev/plain.toml excepts KIND, which is no number at module level"


def test_product_has_no_tuned_number_at_module_level_and_no_empty_name():
    assert not list(map(str, plain_faults(ROOT / name for name in FOLDERS)))
