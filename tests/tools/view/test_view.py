"""Timelines, and the scene and controls that a browser is sent, without a browser."""

import io
import socket
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from palpate.core.geometry import is_closed, signed_volume
from palpate.launch.files.source_map import InputError
from palpate.messages.types import Score, SensorInfo, ShapeModel, SurfacePatch
from palpate.tools.bag.decoding import open_decoded
from palpate.tools.drawables import LAYERS
from palpate.tools.view.live import View, address_of, serving, view_run
from palpate.tools.view.picture import finger_mesh
from palpate.tools.view.timeline import Timeline, read_timeline

PORT = 8470
DRAWN = ("add_glb", "add_mesh_simple", "add_point_cloud", "add_line_segments")
CONTROLS = ("add_html", "add_checkbox", "add_dropdown")


class Seen:
    """Nodes of the scene and controls that a server was asked to show, by name."""

    def __init__(self, server: Any) -> None:
        self.nodes: dict[str, Any] = {}
        self.sources: dict[str, tuple[Any, ...]] = {}
        self.controls: dict[str, Any] = {}
        self._texts: list[Any] = []
        for place, names in ((server.scene, DRAWN), (server.gui, CONTROLS)):
            for name in names:
                setattr(place, name, self._recording(getattr(place, name)))

    def _recording(self, make: Callable[..., Any]) -> Callable[..., Any]:
        def make_and_record(name: str, *arguments: Any, **options: Any) -> Any:
            handle = make(name, *arguments, **options)
            if "visible" in options and name.startswith("/"):
                self.nodes[name], self.sources[name] = handle, arguments
            elif hasattr(handle, "content"):
                self._texts.append(handle)
            else:
                self.controls[name] = handle
            return handle

        return make_and_record

    def names(self) -> set[str]:
        return {name for name, node in self.nodes.items() if node.visible}

    def text(self) -> str:
        return " ".join(text.content for text in self._texts)

    def all(self) -> Any:
        """Everything that is seen, in a form that can be compared."""
        shown = {
            name: (
                tuple(np.round(self.nodes[name].position, 9)),
                *(part if isinstance(part, bytes) else np.asarray(part).tobytes()
                  for part in self.sources[name]),
            )
            for name in self.names()
        }  # fmt: skip
        return shown, self.text()


@pytest.fixture
def server():
    with serving(PORT) as viser_server:
        yield viser_server


@pytest.fixture
def seen(server):
    return Seen(server)


@pytest.fixture
def view(server, seen, run_folder):
    return View(server, read_timeline(run_folder), recorded=True)


def choose(view, seen, label, value):
    seen.controls[label].value = value
    view.draw()


def test_seeking_shows_the_same_as_playing(view, seen):
    view.watched = True
    played = {}
    while view.playing:
        view.pass_time(0.5)
        played[view.when] = seen.all()
    assert len(played) > 15 and view.when == view.line.end
    for when in np.random.default_rng(1).permutation([*played]):
        view.seek(when)
        assert seen.all() == played[when]
    assert len({str(state) for state in played.values()}) > 10


def test_layers_show_what_was_known_and_are_chosen_by_name(view, seen):
    view.seek(0.0)
    assert seen.names() == set()
    view.seek(view.line.end)
    kinds = [name.split("/")[1] for name in seen.names()]
    assert {*kinds} == {"contours", "patch", "finger", "touched", "solid", "untouched"}
    assert kinds.count("contours") == len(view.line.contours)
    parts = [*view.line.drawn(view.line.at(view.line.end))]
    drawn = {f"/{part.path}/{part.time}": part.shape for part in parts}
    for name in (name for name in seen.names() if name.startswith("/contours/")):
        pieces, colour = seen.sources[name][:2]
        np.testing.assert_array_equal(pieces, drawn[name].pieces())
        assert colour == LAYERS["contours"].rgb
    for name, layer in LAYERS.items():
        assert seen.controls[layer.label].value == layer.shown
        choose(view, seen, layer.label, True)
        shown = {path.split("/")[1] for path in seen.names()}
        assert (name in shown) == (name in {part.layer for part in parts})
        assert f'{layer.colour}"></i> {layer.label}' in seen.text()
        choose(view, seen, layer.label, False)
    assert {path.split("/")[1] for path in seen.names()} == {"patch"}


def body_of(seen):
    """The file of the solid that is seen."""
    (name,) = (path for path in seen.names() if path.startswith("/solid/"))
    return seen.sources[name][0]


def solid_of(seen):
    """Its mesh."""
    body = body_of(seen)
    assert b"KHR_materials_unlit" in body and int.from_bytes(body[8:12], "little") == len(body)
    return trimesh.load(io.BytesIO(body), file_type="glb", force="mesh", process=False)


def test_colours_show_deviation_or_uncertainty(view, seen, server, run_folder):
    view.seek(view.line.end)
    body, plain = body_of(seen), solid_of(seen)
    known = {row.tobytes() for row in np.float32(view.line.models[-1].vertices)}
    assert {row.tobytes() for row in np.float32(plain.vertices)} <= known
    assert view.scene.scale is None
    for colouring in ("deviation", "uncertainty"):
        choose(view, seen, "colour", colouring)
        scale = view.scene.scale
        assert scale.name == colouring and scale.top > 0.0
        assert f"{1e3 * scale.top:g}</span>" in seen.text()
        assert len(body_of(seen)) == len(body) and body_of(seen) != body
    view.line.known.surface = None
    view.line._take_truth(view.line.truth)
    choose(view, seen, "colour", "deviation")
    view.seek(view.line.end)
    assert view.scene.scale is None and "the true solid is not known" in seen.text()


def test_time_passes_at_its_speed_while_watched_or_by_touches(view, seen):
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
    # A step is a touch, and pauses.
    times = [touch.time for touch in view.line.touches]
    view.seek(times[4])
    view.step(1)
    assert (view.when, view.playing) == (times[5], False)
    view.step(-1)
    view.step(-1)
    assert view.when == times[3] and f"touch 4 of {len(times)}" in seen.text()
    view.seek(0.0)
    view.step(-1)
    assert view.when == 0.0
    # A slider that is moved is not moved back.
    view.toggle()
    view.pass_time(0.5)
    view.panel.slider.value = 50.0  # its callback has not come yet
    view.pass_time(0.5)
    assert view.panel.slider.value == 50.0


def test_running_graph_is_followed_until_a_user_seeks(server, run_folder):
    past = read_timeline(run_folder)
    line = Timeline(known=past.known)
    view = View(server, line, recorded=False)
    for touch in past.touches[:20]:
        line.touches.append(touch)
        view.pass_time(0.05)
        assert view.when == touch.time
    view.seek(past.touches[3].time)
    line.touches += past.touches[20:]
    view.pass_time(0.05)
    assert view.when == past.touches[3].time
    view.toggle()
    view.pass_time(0.05)
    assert view.when == past.touches[-1].time
    view = View(server, line, recorded=False, following=False)
    view.pass_time(10.0)
    assert view.when == 0.0  # nobody has looked yet: a late watcher sees it from its beginning
    view.watched = True
    view.pass_time(1.0)
    assert 0.0 < view.when < line.end
    view.finish()
    view.pass_time(1e4)
    assert (view.when, view.playing) == (line.end, False)


def test_large_solids_are_thinned_and_few_are_kept(view, seen):
    body = trimesh.creation.uv_sphere(radius=0.03, count=[100, 201])
    vertices, faces = np.array(body.vertices), np.array(body.faces, np.int32)
    model = replace(view.line.models[-1], vertices=vertices, faces=faces)
    view.line.models[-1] = model
    view.seek(view.line.end)
    (drawn, whole), limits = view.scene.triangles, view.scene.settings
    assert whole == len(faces) and limits.max_triangles / 2 < drawn <= limits.max_triangles
    thin = solid_of(seen)
    assert abs(thin.volume) == pytest.approx(body.volume, rel=0.01)
    small = view.line.models[0]
    numbers = range(70)
    view.line.models[:] = [replace(small, number=i, robot_time=float(i)) for i in numbers]
    removed: list[str] = []
    for number in numbers:
        view.seek(float(number))
        handle = seen.nodes[f"/solid/plain/{number}"]
        handle.remove = lambda name=handle.name: removed.append(name)
    assert len(removed) >= len(numbers) - limits.max_solids
    view.seek(0.0)
    assert "/solid/plain/0" in seen.names()


def test_next_free_port_is_taken_silently(server, capsys, monkeypatch):
    with serving(PORT) as other:
        assert other.get_port() > server.get_port() >= PORT
        assert address_of(other).startswith("http://127.0.0.1:")
    assert capsys.readouterr() == ("", "")

    class Taken(socket.socket):
        def bind(self, _):
            raise OSError

    monkeypatch.setattr("socket.socket", Taken)
    with pytest.raises(InputError, match=f"--port {PORT}: it is taken"), serving(PORT):
        pass


def test_view_without_a_run_is_refused(here, runtime, capsys):
    latest = "no graph of yours is running, and runs/latest holds no recording: name a run"
    for run, words in ((None, latest), (here / "none", "does not exist"), (here, "no recording")):
        with pytest.raises(InputError, match=words):
            view_run(run, port=PORT, echo=print)
    assert capsys.readouterr().out == ""


@pytest.fixture(scope="module")
def messages(run_folder):
    return [decoded.message for decoded in open_decoded(run_folder).published()]


def timeline_of(messages):
    line = Timeline()
    for message in messages:
        line.add(message)
    return line


def contents(line):
    """What a timeline holds, as far as it can be compared."""
    touches = [
        (*touch[:3], touch.points.tobytes(), np.float64(touch.force).tobytes())
        for touch in line.touches
    ]
    models = [(model.robot_time, model.number) for model in line.models]
    contours = [(contour.robot_time, contour.id) for contour in line.contours]
    return touches, models, contours, sorted(line.scores), sorted(line.spaces), line.end


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_order_of_arrival_does_not_matter(seed, messages, line):
    mixed = [messages[i] for i in np.random.default_rng(seed).permutation(len(messages))]
    assert contents(timeline_of(mixed)) == contents(line)
    assert np.isfinite([touch.force for touch in line.touches]).any()


def test_moments_grow_with_time_and_touches_lie_on_the_true_surface(line):
    times = np.linspace(-1.0, line.end + 1.0, 500)
    moments = np.array([line.at(time) for time in times])
    assert (np.diff(moments, axis=0) >= 0).all() and not moments[0].any()
    kinds = (line.touches, line.grasps, line.contours, line.models)
    assert tuple(moments[-1]) == tuple(map(len, kinds))
    for number, touch in enumerate(line.touches, 1):  # a touch is there from its end on
        assert line.at(touch.time).touches >= number
        assert line.at(np.nextafter(touch.time, 0.0)).touches < number
    hits = [touch.points for touch in line.touches if touch.outcome == "hit"]
    assert len(hits) > 10 and max(map(len, hits)) <= line.max_points
    assert line.surface.deviations(np.concatenate(hits)).max() < 1e-4


def test_touches_wait_for_the_sensor(messages, line):
    early = timeline_of([patch for patch in messages if isinstance(patch, SurfacePatch)])
    assert early.touches == []
    early.add(next(some for some in messages if isinstance(some, SensorInfo)))
    assert [touch.time for touch in early.touches] == [touch.time for touch in line.touches]
    score = next(some for some in messages if isinstance(some, Score))
    better = replace(score, number=score.number + 100, rms=1e-9)
    assert timeline_of([better, score]).scores[score.number].rms == score.rms
    model = next(some for some in messages if isinstance(some, ShapeModel))
    bare = replace(model, vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), np.int32))
    assert timeline_of([bare]).models == []


def test_drawn_finger_is_closed_with_its_tip_at_the_pad():
    vertices, faces = finger_mesh(np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]))
    assert is_closed(faces) and signed_volume(vertices[faces]) > 0.0
    assert vertices[:, 2].max() == pytest.approx(0.3)
    assert np.abs(vertices - [0.1, 0.2, 0.3]).sum(axis=1).min() == 0.0
