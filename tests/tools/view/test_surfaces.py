from __future__ import annotations

import numpy as np
import pytest

from palpate.tools.view import hex_colour, read_timeline, scale_top, uncertainties, viridis
from palpate.tools.view.picture import finger_mesh


def test_viridis_is_that_of_matplotlib_to_a_fortieth():
    import matplotlib

    values = np.linspace(0.0, 1.0, 256)
    theirs = 255.0 * matplotlib.colormaps["viridis"](values)[:, :3]
    assert np.abs(viridis(values, 1.0) - theirs).max() < 6.0
    assert hex_colour(0.0, 2.0) == "#440154"
    assert hex_colour(5.0, 2.0) == "#fde725"


@pytest.mark.parametrize(
    ("most", "top"), [(0.00013, 0.00015), (0.0001, 0.0001), (0.9, 1.0), (0.0, 1e-6)]
)
def test_a_scale_ends_at_a_round_value_over_nearly_all(most, top):
    assert scale_top(np.linspace(0.0, most, 50) ** 0 * most) == pytest.approx(top)


def test_few_outliers_do_not_take_the_colours_from_all_others():
    values = np.full(1000, 1e-4)
    values[:5] = 1.0
    assert scale_top(values) == pytest.approx(1e-4)


def test_uncertainty_is_told_by_vertex_or_else_by_height(run_folder):
    from dataclasses import replace

    model = read_timeline(run_folder).models[-1]
    by_vertex = replace(model, vertex_errors=np.arange(len(model.vertices)) * 1e-6)
    assert (uncertainties(by_vertex) == by_vertex.vertex_errors).all()
    heights = np.array([model.vertices[:, 2].min(), model.vertices[:, 2].max()])
    by_height = replace(
        model, vertex_errors=np.zeros(len(model.vertices)),
        uncertainty_height=heights, uncertainty=np.array([0.0, 1e-3]), frame=np.eye(7)[6],
    )  # fmt: skip
    share = (model.vertices[:, 2] - heights[0]) / np.ptp(heights)
    assert uncertainties(by_height) == pytest.approx(1e-3 * share)
    without = replace(by_height, uncertainty_height=np.zeros(0), uncertainty=np.zeros(0))
    assert (uncertainties(without) == 0.0).all()


def test_the_drawn_finger_is_closed_and_its_tip_is_at_the_pad():
    from palpate.core import geometry

    vertices, faces = finger_mesh(np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]))
    assert geometry.is_closed(faces)
    assert geometry.signed_volume(vertices[faces]) > 0.0
    assert vertices[:, 2].max() == pytest.approx(0.3)
    assert np.abs(vertices - [0.1, 0.2, 0.3]).sum(axis=1).min() == 0.0
