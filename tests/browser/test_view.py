"""The view in a real browser: what it draws, and what its controls do."""

import re
import threading
import time

import numpy as np
import pytest

from palpate.tools.surfaces import shades
from palpate.tools.view.live import View, address_of, serving
from palpate.tools.view.timeline import read_timeline

from .pictures import colours_in, is_changed, picture_of, share_changed


@pytest.fixture
def view(run_folder):
    """A view of a recording, which stands still at its end, with its time passing."""
    with serving(8480) as server:
        shown = View(server, read_timeline(run_folder), recorded=True)
        shown.seek(shown.line.end)
        ended, tick = threading.Event(), 0.05

        def run():
            while not ended.wait(tick):
                shown.pass_time(tick)

        thread = threading.Thread(target=run)
        thread.start()
        yield shown
        ended.set()
        thread.join()


def opened(open_page, view, *size):
    """The page of a view, once its solid is drawn."""
    # Without fixedDpr viser draws coarsely while the machine is busy, and pictures differ.
    watched = open_page(f"{address_of(view.server)}?fixedDpr=1", *size)
    watched.page.wait_for_selector("canvas")
    watched.page.wait_for_selector("text=robot time")
    until(lambda: colours_in(scene_of(watched.page)) > 50)
    return watched


def scene_of(page):
    """What is seen right of the plots, left of the controls, and under the notice."""
    return picture_of(page)[160:, 300:940]


def still(page, looks=4):
    """What is seen once it has been the same several times: parts come one after the other."""
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


def until_it_looks_as(before, page, seconds=60.0, max_share=0.003):
    end = time.monotonic() + seconds
    while (share := share_changed(before, now := scene_of(page))) >= max_share:
        rows, columns = np.nonzero((before != now).any(axis=2))
        where = f"rows {rows.min()} to {rows.max()}, columns {columns.min()} to {columns.max()}"
        assert time.monotonic() < end, f"{share:.2%} of the picture are different, in {where}"
        time.sleep(0.05)


def figures_of(page):
    """Robot time and touch as the panel shows them."""
    text = page.locator("body").inner_text()
    match = re.search(r"robot time ([\d.]+) s, touch (\d+) of (\d+)", text)
    return float(match[1]), int(match[2]), int(match[3])


def test_controls_change_the_shown_recording(view, open_page):
    watched = opened(open_page, view)
    page, line = watched.page, view.line
    assert figures_of(page) == (round(line.end, 1), len(line.touches), len(line.touches))
    end = still(page, looks=6)  # a busy machine draws parts late

    page.get_by_label("true solid").click()
    until(lambda: is_changed(end, scene_of(page)))
    page.get_by_label("true solid").click()
    until_it_looks_as(end, page)

    slider = page.get_by_role("slider").first
    slider.press("Home")
    until(lambda: figures_of(page)[:2] == (0.0, 0))
    until(lambda: is_changed(end, scene_of(page), min_share=0.03))
    page.get_by_role("button", name="touch ▶").click()
    until(lambda: figures_of(page)[1] == 1)
    slider.press("End")
    until(lambda: figures_of(page)[1] == len(line.touches))
    until_it_looks_as(end, page)

    page.get_by_role("button", name="Play").click()
    until(lambda: 0.0 < figures_of(page)[0] < line.end)
    page.get_by_role("button", name="Pause").click()
    until(lambda: view.playing is False)
    assert (watched.errors, watched.outside()) == ([], [])


@pytest.mark.slow
def test_colours_of_the_solid_are_those_of_the_scale(view, open_page):
    watched = opened(open_page, view)
    watched.page.get_by_role("checkbox", name="touched", exact=True).click()
    watched.page.locator("input[value=plain]").first.click()
    watched.page.get_by_role("option", name="uncertainty").click()
    pixels = np.unique(still(watched.page, looks=2).reshape(-1, 3), axis=0)
    scale = shades(np.linspace(0.0, 1.0, 200), 1.0).astype(float)
    light = np.clip(pixels @ scale.T / (scale**2).sum(axis=1), 0.4, 1.0)
    apart = np.abs(pixels[:, None] - light[..., None] * scale).max(axis=2).min(axis=1)
    assert (apart <= 2).sum() > 20
    assert watched.errors == []


def test_telephone_shows_jumps_and_mostly_the_object(view, open_page):
    watched = open_page(address_of(view.server), 390, 844)
    page = watched.page
    page.wait_for_selector("text=robot time")
    for when in np.random.default_rng(1).uniform(0.0, view.line.end, 3):
        view.seek(when)
        page.wait_for_selector(f"text=robot time {when:.1f} s")
    top = page.get_by_text("contours traced").bounding_box()["y"]
    assert top > 0.6 * 844
    assert page.get_by_role("button", name="Play").is_visible()
    assert not page.get_by_text("true solid", exact=True).first.is_visible()
    assert (watched.errors, watched.outside()) == ([], [])
