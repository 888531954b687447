"""Generalised cylinders and their sections: convexity, meshes, gauges and their bounds."""

import math

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.geometry import solidity
from tests.core.shapes.definitions import HEIGHTS, SOLIDS

ROUND = shapes.SuperellipseSection(np.array([0.03, 0.03]), 1.0)


def test_convexity_is_detected():
    for scales in ([1.0, 0.95, 0.85, 0.4], [1.0, 0.95, 0.85, 0.0], [1.0] * 4):
        for smooth in (False, scales[-1] > 0.0):
            dome = shapes.GeneralisedCylinder(ROUND, np.array(HEIGHTS), np.array(scales), smooth)
            assert dome.convex
    assert not SOLIDS["vase"].solid.convex and not SOLIDS["superellipse"].solid.convex


def test_meshes_converge_with_a_ring_in_each_kink():
    scales = np.array([1.0, 1.0, 0.4, 0.7])
    heights = np.array([0.0, 0.031, 0.05, 0.08])
    solid, volume = shapes.GeneralisedCylinder(ROUND, heights, scales), 0.0
    for rise, a, b in zip(np.diff(heights), scales[:-1], scales[1:], strict=True):
        volume += math.pi * 0.03**2 * rise * (a * a + a * b + b * b) / 3
    meshes = [solid.mesh(level) for level in (2, 3, 4)]
    errors = np.array([volume - solidity(*mesh).volume for mesh in meshes])
    assert (errors > 0).all()
    assert np.diff(np.log2(errors)) == pytest.approx([-2, -2], abs=0.1)
    faces = np.log2([len(mesh.faces) for mesh in meshes])
    assert np.diff(faces) == pytest.approx([2, 2], abs=0.3)
    height, radius = meshes[0].vertices[:, 2], np.hypot(*meshes[0].vertices[:, :2].T)
    for knot, scale in zip(heights, scales, strict=True):
        ring = radius[np.abs(height - knot) < 1e-15]
        assert ring.max() == pytest.approx(0.03 * scale)
    for ends in ([1.0, 0.0], [0.0, 1.0]):  # an apex is one vertex
        cone = shapes.GeneralisedCylinder(ROUND, np.array([0.0, 0.1]), np.array(ends))
        for vertices, triangles in (cone.mesh(0), cone.mesh(3)):
            assert solidity(vertices, triangles).watertight
            assert (np.hypot(*vertices[:, :2].T) < 1e-15).sum() == 2  # and the middle of the cap
    # A lean moves the sections sideways and keeps them level.
    leaning = shapes.GeneralisedCylinder(ROUND, heights, scales, False, 0.5, 0.7).mesh(2)
    shear = np.eye(3)
    shear[:, 2] = [math.sin(0.5) * math.cos(0.7), math.sin(0.5) * math.sin(0.7), math.cos(0.5)]
    assert np.allclose(leaning.vertices, meshes[0].vertices @ shear.T, rtol=0, atol=1e-17)
    assert np.array_equal(leaning.faces, meshes[0].faces)


@pytest.mark.parametrize(("section", "convex"), [
    (shapes.SplineSection(np.full(5, 0.03)), True),
    (shapes.SplineSection(np.array([0.03, 0.02, 0.03, 0.02])), False),
    (shapes.SplineSection(np.array([0.03, 0.022, 0.035, 0.021, 0.027, 0.031])), False),
    (shapes.SuperellipseSection(np.array([0.03, 0.02]), 0.1), True),
    (shapes.SuperellipseSection(np.array([0.02, 0.03]), 1.0), True),
    (shapes.SuperellipseSection(np.array([0.03, 0.02]), 1.7), True),
])  # fmt: skip
def test_gauge_is_1_on_the_outline_and_its_bounds_hold(section, convex):
    points = section.outline(64)
    for share in (0.3, 1.0, 2.0):
        gauge = section.gauge_along(*(share * points.T), np.ones(64), np.ones(64))[0]
        assert np.allclose(gauge, share, rtol=0, atol=1e-14)
    turn = np.arctan2(points[:, 1], points[:, 0])
    assert (np.diff(turn[turn > -1e-12]) > 0).all()
    (x, y), (dx, dy) = np.random.default_rng(1).uniform(-0.04, 0.04, (2, 2, 300))
    step = 1e-6
    there, back = (section.gauge_along(x + s * dx, y + s * dy, dx, dy)[0] for s in (step, -step))
    slope = section.gauge_along(x, y, dx, dy)[1]
    assert np.quantile(np.abs(slope - (there - back) / (2 * step)), 0.95) < 1e-6
    assert np.isfinite(section.gauge_along(*np.zeros((2, 1)), *np.ones((2, 1)))).all()
    traits, azimuth = section.traits, np.linspace(0, 2 * math.pi, 20001)
    x, y = np.cos(azimuth), np.sin(azimuth)
    gauge, slope = section.gauge_along(x, y, -y, x)
    assert traits.radius[0] <= (1 / gauge).min() * (1 + 1e-12)
    assert (1 / gauge).max() * (1 - 1e-12) <= traits.radius[1]
    bends = gauge[3:-3] + np.gradient(np.gradient(gauge, azimuth[1]), azimuth[1])[3:-3]
    assert bends.min() >= -traits.hollow - 1e-3 * traits.steepest
    assert bends.max() <= traits.bulge + 1e-2 * traits.steepest
    steepest = np.hypot(gauge, slope).max()
    assert steepest <= traits.steepest * (1 + 1e-9) and traits.steepest < 1.8 * steepest
    assert (traits.hollow == 0.0) == convex
