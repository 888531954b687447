from __future__ import annotations

import numpy as np

from palpate.core.shapes.icosphere import icosphere
from palpate.core.shapes.winding import is_closed, is_inside_out


def test_a_ball_is_closed_until_a_face_is_taken_away_doubled_or_turned() -> None:
    _, faces = icosphere(2)
    assert is_closed(faces)
    assert is_closed(faces[:, ::-1])
    assert is_closed(np.random.default_rng(0).permutation(faces))
    assert not is_closed(faces[1:])
    assert not is_closed(np.concatenate([faces, faces[:1]]))
    turned = faces.copy()
    turned[7] = turned[7, ::-1]
    assert not is_closed(turned)
    assert not is_closed(faces[:0])


def test_two_balls_are_closed_and_a_fin_is_not() -> None:
    _, faces = icosphere(1)
    assert is_closed(np.concatenate([faces, faces + 42]))
    a, b = faces[0, :2]
    assert not is_closed(np.concatenate([faces, [[a, b, 42]]]).astype(np.int32))


def test_turned_faces_are_seen_wherever_the_mesh_is_and_even_with_a_hole() -> None:
    directions, faces = icosphere(2)
    for place in ([0.0, 0.0, 0.0], [50.0, -20.0, 9.0]):
        for some in (faces, faces[40:]):
            assert not is_inside_out(directions + place, some)
            assert is_inside_out(directions + place, some[:, ::-1])
