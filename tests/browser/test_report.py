"""The report in a real browser: what it draws, and what its controls do."""

import re

import numpy as np
import pytest

from palpate.launch.colours import rgb
from palpate.tools.report.page import write_report
from palpate.tools.surfaces import shades

from .pictures import colours_in, drawn_by, is_changed, is_same, picture_of


@pytest.fixture(scope="session")
def report(run_folder, tmp_path_factory):
    path = tmp_path_factory.mktemp("browser") / "report.html"
    write_report([run_folder], path)
    return path.as_uri()


@pytest.fixture
def opened(open_page, report):
    opened_page = open_page(report)
    drawn(opened_page.page)
    return opened_page


def drawn(page, view: int = 0) -> None:
    """Wait until the view has been drawn and stands still."""
    page.wait_for_selector(f"#view{view}.live[data-drawn]")
    settled(page, view)


def settled(page, view: int = 0) -> None:
    page.evaluate(
        """async (id) => {
            const root = document.getElementById(id);
            let last = -1;
            while (root.dataset.drawn !== last) {
                last = root.dataset.drawn;
                await new Promise((done) => requestAnimationFrame(() => setTimeout(done, 60)));
            }
        }""",
        f"view{view}",
    )


def canvas(page):
    return drawn_by(page.locator("#view0 canvas"))


def control(page, name: str):
    return page.locator(f"#view0 [data-control={name}]")


def seek(page, share: float) -> None:
    control(page, "time").evaluate(
        "(slider, to) => { slider.value = to; slider.dispatchEvent(new Event('input')); }", share
    )
    settled(page)


def test_page_opens_without_errors_or_requests_and_prints_with_its_picture(opened):
    assert (opened.errors, opened.outside()) == ([], [])
    assert colours_in(canvas(opened.page)) > 20
    assert opened.page.locator(".still").is_hidden()
    opened.page.emulate_media(media="print")
    settled(opened.page)
    assert control(opened.page, "play").is_hidden()
    assert len(opened.page.pdf()) > 50_000


def seen_solid(page) -> np.ndarray:
    """Colours (n, 3) of the solid alone, without the white ground."""
    for name in ("contours", "untouched"):
        if control(page, name).count():
            control(page, name).uncheck()
    settled(page)
    seen = canvas(page).reshape(-1, 3).astype(float)
    return seen[seen.min(axis=1) < 255]


def test_first_picture_shows_the_shape_in_light(opened):
    page, colour = opened.page, np.array(rgb("solid"))
    box = page.locator("#view0 canvas").bounding_box()
    assert box["y"] + box["height"] <= 800  # it is seen without scrolling
    seen = seen_solid(page)
    brightness = (seen / colour).mean(axis=1)
    lit = np.abs(seen - brightness[:, None] * colour).max(axis=1) <= 3
    assert lit.mean() > 0.9  # but where edges are smoothed
    assert np.ptp(np.quantile(brightness[lit], [0.05, 0.95])) > 0.15
    assert brightness[lit].min() > 0.4
    # Coloured by deviation it has the colours of the scale.
    control(page, "colour").select_option("deviation")
    solid = seen_solid(page)[::7]
    scale = shades(np.linspace(0.0, 1.0, 64), 1.0).astype(float)
    brightness = np.clip(solid @ scale.T / (scale**2).sum(axis=1), 0.5, 1.0)
    off = np.abs(solid[:, None] - brightness[..., None] * scale).max(axis=2).min(axis=1)
    assert len(solid) > 700
    assert np.quantile(off, 0.9) <= 4  # but where edges are smoothed


def test_toggles_show_and_hide_and_colouring_has_its_scale(opened):
    page, pictures = opened.page, {}
    for name in ("truth", "touched", "solid", "contours", "finger", "lattice", "free", "unknown"):
        before = canvas(page)
        control(page, name).click()
        settled(page)
        hidden = canvas(page)
        assert is_changed(before, hidden)
        control(page, name).click()
        settled(page)
        assert is_same(before, canvas(page))
    for name in ("plain", "deviation", "uncertainty"):
        control(page, "colour").select_option(name)
        settled(page)
        pictures[name] = canvas(page)
        shown = page.locator("#view0 .scale [data-colouring]:visible").all()
        scales = [one.get_attribute("data-colouring") for one in shown]
        assert scales == ([] if name == "plain" else [name])
    assert is_changed(pictures["deviation"], pictures["uncertainty"])
    assert is_changed(pictures["deviation"], pictures["plain"])


def test_slider_goes_through_the_run_and_playing_to_its_end(opened):
    page, end = opened.page, canvas(opened.page)
    readout = control(page, "readout")
    assert readout.inner_text() == "end of the run"
    seek(page, 0.999)
    late = r"[\d.]+ s, \d+ touches, \d+ contours?: model \d+, rms error"
    assert re.match(late, readout.inner_text())
    seek(page, 0.0)
    assert readout.inner_text() == "0.0 s, 0 touches, 0 contours: no model yet"
    assert colours_in(canvas(page)) == 1
    seek(page, 0.6)
    assert 0 < int(re.search(r"(\d+) touch", readout.inner_text())[1]) < 40
    seek(page, 1.0)
    assert is_same(end, canvas(page))
    assert readout.inner_text() == "end of the run"
    seek(page, 0.97)
    control(page, "play").click()
    page.wait_for_function("document.querySelector('[data-control=time]').value === '1'")
    assert readout.inner_text() == "end of the run"


def test_view_is_turned_brought_back_and_goes_to_a_diagnostic(opened):
    page = opened.page
    before, box = canvas(page), page.locator("#view0 canvas").bounding_box()
    page.mouse.move(box["x"] + 300, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 420, box["y"] + 120, steps=4)
    page.mouse.up()
    settled(page)
    assert is_changed(before, canvas(page))
    control(page, "home").click()
    settled(page)
    assert is_same(before, canvas(page))
    page.locator("button.place").first.click()
    settled(page)
    after = canvas(page)
    assert is_changed(before, after)
    mark = np.abs(after.astype(int) - rgb("untouched")).max(axis=2) < 8
    assert mark.sum() > 60


WIDER = """() => [...document.querySelectorAll("body *")].filter((one) =>
    one.getClientRects().length && !one.closest("details, svg, .view3d")
    && one.getBoundingClientRect().right > innerWidth + 1
).map((one) => one.outerHTML.slice(0, 80))"""


@pytest.mark.parametrize("width", [390, 768, 1100])
def test_page_fits_screens_of_any_width_and_the_dark(open_page, report, width):
    opened_page = open_page(report, width, 844, color_scheme="dark")
    page = opened_page.page
    drawn(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(WIDER) == []
    box = page.locator("#view0 canvas").bounding_box()
    assert box["y"] + box["height"] <= 844
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == "rgb(13, 17, 23)"
    assert colours_in(canvas(page)) > 20
    assert opened_page.errors == []


def test_still_replaces_the_view_without_webgl(open_page, report):
    page = open_page("about:blank").page
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page.goto(report)
    page.wait_for_selector(".view3d.static")
    assert page.locator(".still").is_visible()
    assert colours_in(picture_of(page.locator(".still"))) > 20
    assert "picture is a still" in page.locator("#view0 .fallback").inner_text()
    assert control(page, "play").is_hidden()


@pytest.mark.slow
def test_two_runs_turn_together(open_page, run_folder, tmp_path):
    path = tmp_path / "two.html"
    write_report([run_folder, run_folder], path)
    page = open_page(path.as_uri()).page
    for view in (0, 1):
        drawn(page, view)
    views = [page.locator(f"#view{view} canvas") for view in (0, 1)]
    seek(page, 0.5)
    settled(page, 1)
    readouts = [page.locator(f"#view{view} [data-control=readout]").inner_text() for view in (0, 1)]
    assert readouts[0] == readouts[1]
    box = views[0].bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    page.mouse.down()
    page.mouse.move(box["x"] + 180, box["y"] + 100, steps=3)
    page.mouse.up()
    settled(page)
    settled(page, 1)
    assert is_same(*map(drawn_by, views))
