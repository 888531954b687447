"""The scene that a browser is sent, without a browser."""

import io
import time
from contextlib import redirect_stdout
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from palpate.core.geometry import signed_volume, triangle_corners
from palpate.core.touch import Pad
from palpate.launch.files import InputError
from palpate.tools.surfaces import thinned, viridis
from palpate.tools.view import Timeline, live, read_timeline
from palpate.tools.view.browser import MOST_SOLIDS, MOST_TRIANGLES, Wishes
from palpate.tools.view.drawn import (
    LIGHT,
    boundary,
    contour_segments,
    lattice_lines,
    pad_body,
    shaded,
    unlit_glb,
)
from palpate.tools.view.live import View, serving, view_run

PORT = 8470


@pytest.fixture
def server():
    with serving(PORT) as one:
        yield one


@pytest.fixture
def view(server, run_folder):
    return View(server, read_timeline(run_folder), recorded=True)


@pytest.fixture(scope="module")
def ball():
    """A ball of 40,000 triangles."""
    body = trimesh.creation.uv_sphere(radius=0.03, count=[100, 201])
    return np.array(body.vertices), np.array(body.faces, np.int32)


def shown(view):
    """All that is seen: nodes, what they are made of, and what the panel says."""
    nodes, scene = {}, view.scene
    for name in scene._visible:
        node = scene._nodes[name]
        parts = [np.asarray(getattr(node, key, 0)).tobytes() for key in ("points", "colors")]
        nodes[name] = (node.visible, *np.round(node.position, 9), *parts)
    panel = view.panel
    return nodes, panel._state.content, panel._touch.content, panel._legend.content


def test_whoever_jumps_sees_what_whoever_waits_has_seen(view):
    view.watched = True
    played = {}
    while view.playing:
        view.pass_time(0.5)
        played[view.when] = shown(view)
    assert len(played) > 15
    assert view.when == view.line.end
    for when in np.random.default_rng(1).permutation([*played]):
        view.seek(when)
        assert shown(view) == played[when]
    assert len({str(one) for one in played.values()}) > 10


def test_only_what_is_there_at_a_time_is_shown(view):
    view.seek(0.0)
    assert view.scene._visible == set()
    view.seek(view.line.end)
    names = view.scene._visible
    kinds = {name.split("/")[1] for name in names}
    assert kinds == {"contours", "patch", "pad", "points", "solid"}
    assert sum(name.startswith("/contours/") for name in names) == len(view.line.contours)
    assert {name for name, node in view.scene._nodes.items() if node.visible} == names


@pytest.mark.parametrize("wish", ["truth", "free", "unknown", "points"])
def test_a_toggle_shows_and_hides(wish, view):
    view.seek(view.line.end)
    before = set(view.scene._visible)
    box = view.panel._wishes[wish]
    box.value = not box.value
    view.draw()
    assert view.scene._visible != before
    box.value = not box.value
    view.draw()
    assert view.scene._visible == before


def test_colours_mean_something_where_something_is_known(view):
    view.seek(view.line.end)
    assert view.scene.scale is None
    for colouring in ("deviation", "uncertainty"):
        view.panel._wishes["colouring"].value = colouring
        view.draw()
        scale = view.scene.scale
        assert scale is not None and (scale.name, scale.top > 0.0) == (colouring, True)
        assert f"{1e3 * scale.top:g}</span>" in view.panel._legend.content


def test_without_a_truth_there_is_no_deviation(server, run_folder):
    line = read_timeline(run_folder)
    line.truth = None
    view = View(server, line, recorded=True)
    view.panel._wishes["colouring"].value = "deviation"
    view.seek(line.end)
    assert view.scene.scale is None
    assert "the true solid is not known" in view.panel._legend.content


def test_time_passes_at_its_speed_once_somebody_looks_and_not_while_it_is_paused(view):
    view.pass_time(1.0)
    assert view.when == 0.0
    view.watched = True
    view.panel.speed.value = "4x"
    view.pass_time(1.0)
    assert view.when == pytest.approx(4.0)
    view.toggle()
    view.pass_time(1.0)
    assert view.when == pytest.approx(4.0)
    view.toggle()
    view.pass_time(1e4)
    assert (view.when, view.playing) == (view.line.end, False)
    view.toggle()
    assert (view.when, view.playing) == (0.0, True)


def test_a_step_is_a_touch_and_stays_there(view):
    times = [one.time for one in view.line.touches]
    view.seek(times[4])
    view.step(1)
    assert (view.when, view.playing) == (times[5], False)
    view.step(-1)
    view.step(-1)
    assert view.when == times[3]
    assert f"touch 4 of {len(times)}" in view.panel._state.content
    view.seek(0.0)
    view.step(-1)
    assert view.when == 0.0


def test_a_slider_that_somebody_moves_is_not_moved_back_by_the_time_that_passes(view):
    view.watched = True
    view.pass_time(0.5)
    view.panel.slider.value = 50.0  # its callback has not come yet
    view.pass_time(0.5)
    assert view.panel.slider.value == 50.0
    view._scrubbed(SimpleNamespace(client="somebody"))
    assert (view.when, view.playing) == (50.0, False)
    view.panel.slider.value = view.panel.slider.max
    view._scrubbed(SimpleNamespace(client="somebody"))
    assert view.when == pytest.approx(view.line.end)


def test_a_running_graph_is_followed_until_somebody_looks_back(server, run_folder):
    past = read_timeline(run_folder)
    line = Timeline(pad=past.pad)
    view = View(server, line, recorded=False)
    for one in past.touches[:20]:
        line.touches.append(one)
        view.pass_time(0.05)
        assert view.when == one.time
    view.seek(past.touches[3].time)
    line.touches += past.touches[20:]
    view.pass_time(0.05)
    assert view.when == past.touches[3].time
    view.toggle()
    view.pass_time(0.05)
    assert view.when == past.touches[-1].time


def test_a_run_that_is_watched_late_is_shown_from_its_beginning(server, run_folder):
    line = read_timeline(run_folder)
    view = View(server, line, recorded=False, following=False)
    view.pass_time(10.0)
    assert view.when == 0.0  # nobody has looked yet
    view.watched = True
    view.pass_time(1.0)
    assert 0.0 < view.when < line.end
    view.finish()
    view.pass_time(1e4)
    assert (view.when, view.playing) == (line.end, False)
    view.toggle()
    assert view.when == 0.0


def test_only_so_many_solids_are_kept_in_the_browser(view):
    model = view.line.models[0]
    more = range(MOST_SOLIDS + 20)
    view.line.models[:] = [replace(model, number=i, robot_time=float(i)) for i in more]
    for i in more:
        view.seek(float(i))
    assert len([one for one in view.scene._nodes if one.startswith("/solid")]) <= MOST_SOLIDS
    view.seek(0.0)
    assert "/solid/plain/0" in view.scene._visible


@pytest.mark.slow
def test_a_jump_takes_a_fifth_of_a_second_of_the_processor_at_most(view, ball):
    vertices, faces = ball
    last = view.line.models[-1]
    view.line.models[-1] = replace(last, vertices=vertices, faces=faces)
    while view.scene.prepare(Wishes()):
        pass
    taken = []
    for when in np.random.default_rng(1).uniform(0.0, view.line.end, 30):
        before = time.thread_time()
        view.seek(when)
        taken.append(time.thread_time() - before)
    assert max(taken) < 0.2


def test_a_surface_of_too_many_triangles_is_thinned_to_vertices_that_it_has(ball):
    vertices, faces = ball
    kept, fewer = thinned(vertices, faces, MOST_TRIANGLES)
    assert MOST_TRIANGLES / 2 < len(fewer) <= MOST_TRIANGLES
    assert len(np.unique(kept)) == len(kept)
    assert fewer.max() < len(kept)
    volume = signed_volume(triangle_corners(vertices, faces))
    assert signed_volume(triangle_corners(vertices[kept], fewer)) == pytest.approx(volume, rel=0.01)
    every, same = thinned(vertices, faces, len(faces))
    assert (every == np.arange(len(vertices))).all() and same is faces


def test_a_coloured_surface_is_one_that_no_light_changes():
    colours = viridis(np.array([0.0, 0.5, 1.0]), 1.0)
    body = unlit_glb(np.eye(3), np.array([[0, 1, 2]], np.int32), colours)
    assert b"KHR_materials_unlit" in body
    read = trimesh.load(io.BytesIO(body), file_type="glb", force="mesh")
    assert np.sort(read.vertices, axis=0) == pytest.approx(np.sort(np.eye(3), axis=0))
    assert int.from_bytes(body[8:12], "little") == len(body)


def test_a_plain_surface_is_brightest_where_it_faces_the_light(ball):
    vertices, faces = ball
    colours = shaded(vertices, faces, (200, 100, 0))
    facing = vertices @ LIGHT
    assert vertices[colours[:, 0].argmax()] @ LIGHT == pytest.approx(facing.max(), rel=0.01)
    assert np.abs(colours.max(axis=0).astype(int) - [200, 100, 0]).max() <= 1
    assert colours[:, 0].min() == pytest.approx(80, abs=1)


def test_a_pad_is_closed_and_its_face_looks_along_its_axis():
    pad = Pad(rows=5, cols=7, pitch=0.001, thickness=0.003, dome=60.0, saturation=0.8)
    body = trimesh.Trimesh(*pad_body(pad), process=False)
    assert body.is_watertight and body.volume > 0.0
    assert body.bounds[1] == pytest.approx([0.003, 0.002, 0.0])


def test_a_lattice_is_drawn_on_its_outside():
    grid = np.stack(np.meshgrid(*map(np.arange, (4, 4, 5)), indexing="ij"), axis=-1) * 1.0
    points, pairs = lattice_lines(grid)
    ends = points[pairs]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) == pytest.approx(1.0)
    outside = ((ends == 0.0) | (ends == [3.0, 3.0, 4.0])).any(axis=2)
    assert outside.all()
    assert len(np.unique(pairs)) == 4 * 4 * 5 - 2 * 2 * 3


def test_a_contour_is_drawn_without_its_gaps(contour):
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    ring = replace(contour, points=points, normals=np.zeros((4, 3)), status="closed")
    assert len(contour_segments(ring)) == 4
    assert len(contour_segments(replace(ring, status="occluded"))) == 3
    assert len(contour_segments(replace(ring, gap_starts=points[1:2]))) == 3
    assert len(contour_segments(contour)) == 0


def test_the_boundary_of_free_and_of_unknown_space_touch_each_other(view):
    space = view.line.space_at(view.line.at(view.line.end))
    assert space is not None
    free, unknown = boundary(space, free=True), boundary(space, free=False)
    assert len(free) and len(unknown)
    for points, state in ((free, 1), (unknown, 0)):
        places = np.rint((points - space.low) / space.step).astype(int)
        assert (space.states[tuple(places.T)] == state).all()


def test_the_next_free_port_is_taken_and_nothing_is_printed(server, capsys):
    with serving(PORT) as other:
        assert other.get_port() > server.get_port() >= PORT
        assert live.address_of(other).startswith("http://127.0.0.1:")
    assert capsys.readouterr() == ("", "")


def test_no_free_port_is_told_in_a_sentence(monkeypatch):
    monkeypatch.setattr(live, "PORTS", 0)
    with pytest.raises(InputError, match=f"--port {PORT}: it is taken"), serving(PORT):
        pass


def test_there_is_nothing_to_view_where_nothing_ran(here, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(here))
    told = "no graph of yours is running, and runs/latest holds no recording: name a run"
    with pytest.raises(InputError, match=told):
        view_run(None, port=PORT, echo=print)
    with pytest.raises(InputError, match="does not exist"):
        view_run(here / "none", port=PORT, echo=print)
    with redirect_stdout(io.StringIO()) as out, pytest.raises(InputError):
        view_run(here, port=PORT, echo=print)
    assert out.getvalue() == ""
