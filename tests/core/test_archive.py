import json
import math
import re
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from palpate.core.archive import (
    FORM_KEY,
    Arrays,
    arrays_from_bytes,
    class_name,
    class_named,
    tree_from_arrays,
    tree_to_arrays,
    tree_to_bytes,
)
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.solid import LatticeSolid
from palpate.core.rebuild.surface.closed import Curvatures
from palpate.core.shapes.global_deformations import Unbent
from palpate.core.splines.spline_volumes import Parallelepiped

METHODS = ("lattice", "skin", "thesis", "coarse")


def ring(z, count=30):
    turn = 2 * np.pi * np.arange(count) / count
    r = 0.03 * math.sqrt(1.1 - (z / 0.05) ** 2) * (1 + 0.05 * np.cos(2 * turn))
    return np.column_stack([r * np.cos(turn), 0.8 * r * np.sin(turn), np.full(count, z)])


@cache
def solid_by(method):
    contours = [ring(z) for z in np.linspace(-0.045, 0.045, 9)]
    tops = None if method == "coarse" else [[0, 0, -0.05], [0, 0, 0.05]]
    return reconstruct(contours, method=method, tops=tops)


def form_of(arrays):
    return json.loads(str(arrays[FORM_KEY]))


def with_form(arrays, change):
    form = form_of(arrays)
    change(form)
    return {**arrays, FORM_KEY: np.array(json.dumps(form))}


@pytest.mark.parametrize("method", METHODS)
def test_a_solid_comes_back_the_same_to_the_last_bit(method):
    solid = solid_by(method)
    back = tree_from_arrays(tree_to_arrays(solid))
    assert np.array_equal(*map(tree_to_bytes, (solid, back)))
    v, turns = np.random.default_rng(0).random((2, 300))
    assert np.array_equal(solid.surface.at(v, turns), back.surface.at(v, turns))
    assert np.array_equal(solid.surface.normals(v, turns), back.surface.normals(v, turns))
    assert np.array_equal(solid.mesh().vertices, back.mesh().vertices)
    assert np.array_equal(solid.mesh().faces, back.mesh().faces)
    assert solid.health() == back.health()
    assert solid.uncertainty() == back.uncertainty()
    assert solid.uncovered == back.uncovered
    assert np.array_equal(*map(tree_to_bytes, (solid.measures(), back.measures())))


@pytest.mark.parametrize("method", METHODS)
def test_a_solid_that_came_back_takes_further_contours_like_the_first(method):
    solid = solid_by(method)
    back = tree_from_arrays(tree_to_arrays(solid))
    assert np.array_equal(
        *map(tree_to_bytes, (solid.update(ring(0.003)), back.update(ring(0.003))))
    )


def test_the_lattice_and_the_band_of_a_solid_that_came_back_are_the_same():
    solid = solid_by("lattice")
    back = tree_from_arrays(tree_to_arrays(solid))
    assert solid.lattice is not None and solid.closed is not None
    points = 0.4 * solid.evidence.slices.fine.reshape(-1, solid.evidence.slices.fine.shape[-1])
    places = np.column_stack([points[:50, 0], points[:50, 1], np.linspace(-0.03, 0.03, 50)])
    before, after = solid.lattice.lattice, back.lattice.lattice
    assert np.array_equal(before.deform(places), after.deform(places))
    heights, turns = np.linspace(-0.04, 0.04, 21), np.arange(17) / 17
    first, second = solid.closed.loft, back.closed.loft
    assert np.array_equal(first.deviation(heights, turns), second.deviation(heights, turns))


def test_a_solid_goes_through_bytes_and_they_are_always_the_same():
    solid = solid_by("skin")
    data = tree_to_bytes(solid)
    assert data.dtype == np.uint8
    assert data.tobytes() == tree_to_bytes(solid).tobytes()
    assert np.array_equal(*map(tree_to_bytes, (tree_from_arrays(arrays_from_bytes(data)), solid)))


@pytest.mark.parametrize("data", [b"", b"nothing", b"PK\x03\x04 and no more"])
def test_bytes_of_something_else_are_refused(data):
    with pytest.raises(ValueError):
        arrays_from_bytes(np.frombuffer(data, np.uint8))


def test_numbers_texts_and_containers_keep_their_kinds():
    tree = {
        "a": (1, 2.0, True, None, "text"),
        "b": [math.inf, -math.inf, 1e-300],
        "c": {"nested": (np.float64(2.5), np.int32(3))},
    }
    back = tree_from_arrays(tree_to_arrays(tree))
    assert back == tree
    assert [type(item) for item in back["a"]] == [int, float, bool, type(None), str]
    assert [type(item) for item in back["c"]["nested"]] == [np.float64, np.int32]
    assert math.isnan(tree_from_arrays(tree_to_arrays((math.nan,)))[0])


@pytest.mark.parametrize(
    "array",
    [
        np.arange(24.0).reshape(2, 3, 4).transpose(2, 0, 1),
        np.asfortranarray(np.arange(6).reshape(2, 3)),
        np.zeros((0, 3)),
        np.array(4.5),
        np.array([[True, False]]),
        np.arange(12.0).reshape(3, 4)[:, ::2],
    ],
    ids=["transposed", "fortran", "empty", "single", "bool", "strided"],
)
def test_arrays_keep_values_kind_and_the_order_of_their_axes(array):
    back = tree_from_arrays(tree_to_arrays(array))
    assert np.array_equal(back, array)
    assert back.dtype == array.dtype
    assert back.flags.f_contiguous == array.flags.f_contiguous or not array.flags.contiguous
    longer = [axis for axis in range(array.ndim) if array.shape[axis] > 1]
    assert sorted(longer, key=lambda i: -back.strides[i]) == sorted(
        longer, key=lambda i: -array.strides[i]
    )


def test_what_is_shared_is_kept_once_and_shared_again():
    shared = np.arange(1000.0)
    arrays = tree_to_arrays((shared, [shared], {"again": shared}))
    assert sum(array.size for name, array in arrays.items() if name != FORM_KEY) == 1000
    first, (second,), rest = tree_from_arrays(arrays)
    assert first is second is rest["again"]


def test_what_cannot_be_kept_is_named_with_its_path():
    solid = solid_by("skin")
    with pytest.raises(ValueError, match="solid/rebuilder cannot be kept: it is a function"):
        tree_to_arrays(replace(solid, rebuilder=lambda evidence: solid))
    with pytest.raises(ValueError, match=r"solid/1/x cannot be kept: it is a set"):
        tree_to_arrays((0, {"x": {1, 2}}))
    with pytest.raises(ValueError, match="solid must have texts as keys"):
        tree_to_arrays({1: 2})
    with pytest.raises(ValueError, match="solid must be an array of numbers, got object"):
        tree_to_arrays(np.array([None]))


def test_a_class_goes_by_its_own_name_which_no_other_may_have():
    assert class_name(LatticeSolid) == "LatticeSolid"
    moved = dataclass(type("LatticeSolid", (), {"__module__": "palpate.core.rebuild.elsewhere"}))
    assert class_name(moved) is None
    with pytest.raises(ValueError, match="archives hold no class 'Unbent'"):
        class_name(Unbent)


def test_an_archive_with_the_older_name_of_its_class_is_read():
    arrays = tree_to_arrays(solid_by("skin"))
    older = str(arrays[FORM_KEY]).replace('"class":"LatticeSolid"', '"class":"Solid"', 1)
    assert older != str(arrays[FORM_KEY])
    assert isinstance(tree_from_arrays({**arrays, FORM_KEY: np.array(older)}), LatticeSolid)


def test_an_archive_tells_no_module_so_that_modules_may_move():
    forms = json.dumps([form_of(tree_to_arrays(solid_by(method))) for method in METHODS])
    names = set(re.findall(r'"class": "(.*?)"', forms))
    assert len(names) > 30
    assert all(name.isidentifier() and class_name(class_named(name)) == name for name in names)


@dataclass
class Foreign:
    a: int = 0


def test_only_classes_of_the_core_have_a_name():
    assert class_name(Foreign) is None
    assert class_name(int) is None
    assert class_named(class_name(LatticeSolid) or "") is LatticeSolid
    assert class_named(class_name(Curvatures) or "") is Curvatures
    with pytest.raises(ValueError, match="cannot be kept: it is a Foreign"):
        tree_to_arrays(Foreign())


@pytest.mark.parametrize(
    "name",
    [
        "os:system",
        "builtins:eval",
        "Nothing",
        "np",
        "reconstruct",
        "rebuild.solid:LatticeSolid",
        "..messages.codec:Codec",
        "LatticeSolid.__init__",
        "_Writer",
        "Unbent",  # two of them
        "",
        "x" * 10_000,
    ],
)
def test_no_other_class_is_ever_built(name):
    with pytest.raises(ValueError, match="archives hold no class"):
        class_named(name)
    arrays: Arrays = {
        FORM_KEY: np.array(json.dumps({"version": 1, "tree": {"class": name, "fields": {}}}))
    }
    with pytest.raises(ValueError, match="archives hold no class"):
        tree_from_arrays(arrays)


def test_a_form_of_another_version_or_none_is_refused():
    arrays = tree_to_arrays((1, np.ones(2)))
    with pytest.raises(ValueError, match="version must be 1, got 2"):
        tree_from_arrays(with_form(arrays, lambda form: form.update(version=2)))
    with pytest.raises(ValueError, match="must tell its version and its tree"):
        tree_from_arrays(with_form(arrays, lambda form: form.pop("tree")))
    with pytest.raises(ValueError, match="must have the text 'form'"):
        tree_from_arrays({name: array for name, array in arrays.items() if name != FORM_KEY})
    with pytest.raises(ValueError, match="must be JSON"):
        tree_from_arrays({FORM_KEY: np.array("{")})


@pytest.mark.parametrize(
    "node",
    [
        {"same": "solid/elsewhere"},
        {"float": "1e3"},
        {"tuple": 3},
        {"what": 1},
        {},
        [1],
        {"array": 3},
    ],
)
def test_a_node_without_meaning_is_refused(node):
    with pytest.raises(ValueError, match="solid of the archive has no meaning"):
        tree_from_arrays({FORM_KEY: np.array(json.dumps({"version": 1, "tree": node}))})


def test_what_is_nested_without_end_is_refused():
    deep = '{"tuple":[' * 900 + "1" + "]}" * 900
    text = f'{{"version":1,"tree":{deep}}}'
    with pytest.raises(ValueError, match=r"too deeply|must be JSON"):
        tree_from_arrays({FORM_KEY: np.array(text)})


def test_missing_arrays_wrong_kinds_and_orders_are_refused():
    arrays = tree_to_arrays((np.ones((2, 3)).T,))
    with pytest.raises(ValueError, match="there is no array 'solid/0'"):
        tree_from_arrays({FORM_KEY: arrays[FORM_KEY]})
    with pytest.raises(ValueError, match="must be numbers"):
        tree_from_arrays({**arrays, "solid/0": np.array(["a"])})
    with pytest.raises(ValueError, match="its axes in an order"):
        tree_from_arrays({**arrays, "solid/0": np.ones(3)})


def test_a_class_with_other_fields_is_of_another_version():
    arrays = tree_to_arrays(solid_by("skin"))
    with pytest.raises(ValueError, match=r"is a LatticeSolid of another version: extra"):
        tree_from_arrays(with_form(arrays, lambda form: form["tree"]["fields"].update(extra=1)))


def test_what_a_field_cannot_hold_is_refused():
    arrays = tree_to_arrays(solid_by("skin"))
    with pytest.raises(ValueError, match="solid/model of the archive cannot be a int"):
        tree_from_arrays(with_form(arrays, lambda form: form["tree"]["fields"].update(model=1)))
    with pytest.raises(ValueError, match="solid/method of the archive cannot be a str"):
        tree_from_arrays(with_form(arrays, lambda form: form["tree"]["fields"].update(method="x")))


def test_what_a_class_refuses_is_refused():
    frame = Parallelepiped(np.zeros(3), np.eye(3))
    arrays = tree_to_arrays(frame)
    broken = {**arrays, "solid/corner": np.array([0.0, np.nan, 0.0])}
    with pytest.raises(ValueError, match="finite"):
        tree_from_arrays(broken)
