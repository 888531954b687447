"""The view in a real browser: what it draws, what its controls do, and how fast."""

import re
import threading
import time

import numpy as np
import pytest

from palpate.tools.surfaces import shades
from palpate.tools.view import read_timeline
from palpate.tools.view.live import TICK, View, address_of, serving

from .pictures import colours_in, picture_of, share_changed

CHANGED = 0.003  # Share of the pixels
TELL_FRAMES = """(seconds) => new Promise((done) => {
    const begun = performance.now();
    let frames = 0;
    const count = () => {
        frames += 1;
        const passed = (performance.now() - begun) / 1000;
        if (passed > seconds) done(frames / passed); else requestAnimationFrame(count);
    };
    requestAnimationFrame(count);
})"""


@pytest.fixture
def view(run_folder):
    """A view of a recording, which stands still at its end, with its time passing."""
    with serving(8480) as server:
        found = View(server, read_timeline(run_folder), recorded=True)
        found.seek(found.line.end)
        ended = threading.Event()

        def run():
            while not ended.wait(TICK):
                found.pass_time(TICK)

        thread = threading.Thread(target=run)
        thread.start()
        yield found
        ended.set()
        thread.join()


def opened(open_page, view, *size):
    """The page of a view, once its solid is drawn."""
    found = open_page(address_of(view.server), *size)
    found.page.wait_for_selector("canvas")
    found.page.wait_for_selector("text=robot time")
    until(lambda: colours_in(scene_of(found.page)) > 50)
    return found


def scene_of(page):
    """What is seen right of the plots, left of the controls, and under the notice."""
    return picture_of(page)[160:, 300:940]


def still(page, looks=4):
    """What is seen once it has been the same for so many looks: parts come one after the other."""
    seen, same = scene_of(page), 0
    while same < looks:
        time.sleep(0.5)
        now = scene_of(page)
        same = same + 1 if share_changed(seen, now) == 0.0 else 0
        seen = now
    return seen


def until(holds, seconds=60.0):
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it does not come to be"
        time.sleep(0.05)


def told(page):
    """Robot time and touch as the panel tells them."""
    text = page.locator("body").inner_text()
    found = re.search(r"robot time ([\d.]+) s, touch (\d+) of (\d+)", text)
    assert found is not None
    return float(found[1]), int(found[2]), int(found[3])


def test_a_recording_is_seen_and_its_controls_do_what_they_say(view, open_page, capsys):
    watched = opened(open_page, view)
    page, line = watched.page, view.line
    assert told(page) == (round(line.end, 1), len(line.touches), len(line.touches))
    end = still(page)

    page.get_by_label("true solid").click()
    until(lambda: share_changed(end, scene_of(page)) > CHANGED)
    page.get_by_label("true solid").click()
    until(lambda: share_changed(end, scene_of(page)) < CHANGED)

    slider = page.get_by_role("slider").first
    slider.press("Home")
    until(lambda: told(page)[:2] == (0.0, 0))
    until(lambda: share_changed(end, scene_of(page)) > 10 * CHANGED)
    page.get_by_role("button", name="touch ▶").click()
    until(lambda: told(page)[1] == 1)
    slider.press("End")
    until(lambda: told(page)[1] == len(line.touches))
    until(lambda: share_changed(end, scene_of(page)) < CHANGED)

    page.get_by_role("button", name="Play").click()
    until(lambda: 0.0 < told(page)[0] < line.end)
    page.get_by_role("button", name="Pause").click()
    until(lambda: view.playing is False)

    slider.press("End")
    rate = frames_while_turning(page)
    with capsys.disabled():
        print(f"\n{rate:.1f} frames a second of {view.scene.triangles[0]:,} triangles", end=" ")
    assert rate > 1.0  # a guard: other processes may have the machine
    assert (watched.errors, watched.outside()) == ([], [])


def frames_while_turning(page):
    page.mouse.move(620, 500)
    page.mouse.down()
    page.evaluate(f"() => {{ window.rate = 0; ({TELL_FRAMES})(2).then((x) => window.rate = x); }}")
    for step in range(60):
        page.mouse.move(620 + 60 * np.sin(step / 8), 500)
        time.sleep(0.03)
    page.mouse.up()
    page.wait_for_function("() => window.rate > 0")
    return page.evaluate("() => window.rate")


def test_colours_of_the_solid_are_those_of_the_scale_in_light(view, open_page):
    view.panel._wishes["points"].value = False
    view.panel._wishes["colouring"].value = "uncertainty"
    view.draw()
    watched = opened(open_page, view)
    pixels = np.unique(scene_of(watched.page).reshape(-1, 3), axis=0)
    scale = shades(np.linspace(0.0, 1.0, 200), 1.0).astype(float)
    light = np.clip(pixels @ scale.T / (scale**2).sum(axis=1), 0.4, 1.0)
    apart = np.abs(pixels[:, None] - light[..., None] * scale).max(axis=2).min(axis=1)
    assert (apart <= 2).sum() > 20
    assert watched.errors == []


def test_a_jump_is_seen_at_once_also_on_a_telephone(view, open_page, capsys):
    watched = open_page(address_of(view.server), 390, 844)
    page = watched.page
    page.wait_for_selector("text=robot time")
    taken = []
    for when in np.random.default_rng(1).uniform(0.0, view.line.end, 8):
        begun = time.monotonic()
        view.seek(when)
        page.wait_for_function(
            "(text) => document.body.innerText.includes(text)", arg=f"robot time {when:.1f} s"
        )
        taken.append(time.monotonic() - begun)
    with capsys.disabled():
        print(f"\na jump is told after {1e3 * np.median(taken):.0f} ms", end=" ")
    assert np.median(taken) < 1.0  # a guard: other processes may have the machine
    assert (watched.errors, watched.outside()) == ([], [])


def test_on_a_telephone_the_panel_leaves_most_of_the_window_to_the_object(view, open_page):
    page = open_page(address_of(view.server), 390, 844).page
    page.wait_for_selector("text=robot time")
    top = page.get_by_text("contours traced").bounding_box()["y"]
    assert top > 0.6 * 844
    assert page.get_by_role("button", name="Play").is_visible()
    assert not page.get_by_text("true solid", exact=True).first.is_visible()
