from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.launch.bag.decoded import open_source
from palpate.launch.bag.export_npz import write_npz
from palpate.messages.types import ShapeModel

Arrays = dict[str, Any]


@pytest.fixture
def arrays(explored: Path, tmp_path: Path) -> Arrays:
    count = write_npz(open_source(explored), tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz", allow_pickle=False) as file:
        found = dict(file)
    assert len(found) == count
    return found


def test_fields_become_arrays_with_the_messages_first(arrays: Arrays) -> None:
    assert arrays["touch_raw.array"].shape == (3, 2, 3)
    assert arrays["touch_raw.array"][2].tolist() == [[2.0, 3.0, 4.0], [5.0, 6.0, 7.0]]
    assert arrays["touch_raw.pose"][:, 0] == pytest.approx([0.01, 0.011, 0.012])
    assert arrays["touch_raw.seq"].tolist() == [0, 1, 2]
    assert arrays["touch_raw.sent_s"] == pytest.approx([0.014, 0.021, 0.028], abs=1e-12)
    assert arrays["touch_raw.robot_time"].tolist() == [0.0, 0.5, 1.0]


def test_kinds_of_numbers_are_kept(arrays: Arrays) -> None:
    kinds = {name: arrays[f"touch_patch.{name}"].dtype.str for name in ("mask", "umbilic", "goal")}

    assert kinds == {"mask": "|b1", "umbilic": "|b1", "goal": "<i8"}
    assert arrays["truth.faces"].dtype == np.int32
    assert arrays["truth.faces"].shape == (1, 4, 3)


def test_texts_are_unicode_of_one_width(arrays: Arrays) -> None:
    assert arrays["log.text"].tolist() == ["a, b\n=c"]
    assert arrays["touch_raw.outcome"].dtype == "<U3"


def test_messages_of_several_lengths_are_joined(arrays: Arrays) -> None:
    assert arrays["contour_traced.points"].shape == (4, 3)
    assert arrays["contour_traced.points.lengths"].tolist() == [1, 3]
    assert arrays["contour_traced.points"][1:].tolist() == np.arange(9.0).reshape(3, 3).tolist()
    assert arrays["contour_traced.gap_whys"].tolist() == ["missed"]
    assert arrays["contour_traced.gap_whys.lengths"].tolist() == [0, 1]


def test_arrays_that_differ_in_other_axes_are_flattened(
    arrays: Arrays, tetrahedron: ShapeModel
) -> None:
    flat, shapes = arrays["model_shape.control"], arrays["model_shape.control.shapes"]

    assert shapes.tolist() == [[4, 4, 4, 3], [4, 4, 5, 3]]
    first, second = np.split(flat, np.cumsum(shapes.prod(axis=1))[:-1])
    assert np.array_equal(first.reshape(shapes[0]), tetrahedron.control)
    assert second.size == shapes[1].prod()


def test_lists_of_one_length_are_stacked(arrays: Arrays) -> None:
    assert arrays["model_shape.contours"].tolist() == [[0, 1], [0, 1]]
    assert arrays["model_shape.probes"].shape == (2, 0)
    assert arrays["model_shape.probes"].dtype == np.int64


def test_tables_have_an_array_for_each_name_and_nan_where_it_is_missing(arrays: Arrays) -> None:
    assert arrays["model_shape.health.condition"].tolist() == [3.5, 1.5]
    assert np.isnan(arrays["model_shape.health.folds"]).tolist() == [True, False]
    assert np.isnan(arrays["plan_done.bound"]).all()


def test_the_same_recording_gives_the_same_file(explored: Path, tmp_path: Path) -> None:
    paths = tmp_path / "a.npz", tmp_path / "b.npz"
    for path in paths:
        write_npz(open_source(explored, ["/touch/raw"]), path)

    assert paths[0].read_bytes() == paths[1].read_bytes()
