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


def test_page_opens_without_errors_or_requests(opened):
    assert opened.errors == []
    assert opened.outside() == []
    assert colours_in(canvas(opened.page)) > 20
    assert opened.page.locator(".still").is_hidden()


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


def test_colours_of_the_solid_are_those_of_the_scale(opened):
    page = opened.page
    control(page, "colour").select_option("deviation")
    solid = seen_solid(page)[::7]
    scale = shades(np.linspace(0.0, 1.0, 64), 1.0).astype(float)
    brightness = np.clip(solid @ scale.T / (scale**2).sum(axis=1), 0.5, 1.0)
    off = np.abs(solid[:, None] - brightness[..., None] * scale).max(axis=2).min(axis=1)
    assert len(solid) > 700
    assert np.quantile(off, 0.9) <= 4  # but where edges are smoothed


def test_toggles_show_and_hide(opened):
    page = opened.page
    for name in ("truth", "touched", "solid", "contours", "finger", "lattice", "free", "unknown"):
        before = canvas(page)
        control(page, name).click()
        settled(page)
        hidden = canvas(page)
        assert is_changed(before, hidden)
        control(page, name).click()
        settled(page)
        assert is_same(before, canvas(page))


def test_slider_goes_through_the_run(opened):
    page = opened.page
    end = canvas(page)
    readout = control(page, "readout").inner_text()
    assert readout == "end of the run"
    seek(page, 0.999)
    late = control(page, "readout").inner_text()
    assert re.match(r"[\d.]+ s, \d+ touches, \d+ contours?: model \d+, rms error", late)
    seek(page, 0.0)
    assert control(page, "readout").inner_text() == "0.0 s, 0 touches, 0 contours: no model yet"
    assert colours_in(canvas(page)) == 1
    seek(page, 0.6)
    between = re.search(r"(\d+) touch", control(page, "readout").inner_text())
    assert between
    assert 0 < int(between[1]) < 40
    seek(page, 1.0)
    assert is_same(end, canvas(page))
    assert control(page, "readout").inner_text() == readout


def test_playing_goes_on_to_the_end(opened):
    page = opened.page
    seek(page, 0.97)
    control(page, "play").click()
    page.wait_for_function("document.querySelector('[data-control=time]').value === '1'")
    assert control(page, "readout").inner_text() == "end of the run"


def test_colouring_can_be_chosen_with_its_scale(opened):
    page, pictures = opened.page, {}
    for name in ("plain", "deviation", "uncertainty"):
        control(page, "colour").select_option(name)
        settled(page)
        pictures[name] = canvas(page)
        shown = page.locator("#view0 .scale [data-colouring]:visible")
        assert [shown.nth(i).get_attribute("data-colouring") for i in range(shown.count())] == (
            [] if name == "plain" else [name]
        )
    assert is_changed(pictures["deviation"], pictures["uncertainty"])
    assert is_changed(pictures["deviation"], pictures["plain"])


def test_view_is_turned_and_brought_back(opened):
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


def test_click_on_a_diagnostic_goes_to_its_place(opened):
    page = opened.page
    before = canvas(page)
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
def test_nothing_is_wider_than_the_page(open_page, report, width):
    page = open_page(report, width, 844).page
    drawn(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(WIDER) == []


def test_page_fits_a_phone_in_the_dark(open_page, report):
    opened_page = open_page(report, 390, 844, color_scheme="dark")
    page = opened_page.page
    drawn(page)
    box = page.locator("#view0 canvas").bounding_box()
    assert box["y"] + box["height"] <= 844
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == "rgb(13, 17, 23)"
    assert colours_in(canvas(page)) > 20
    assert opened_page.errors == []


def test_still_replaces_the_view_without_webgl(open_page, report, monkeypatch):
    opened_page = open_page("about:blank")
    opened_page.page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    opened_page.page.goto(report)
    opened_page.page.wait_for_selector(".view3d.static")
    assert opened_page.page.locator(".still").is_visible()
    assert colours_in(picture_of(opened_page.page.locator(".still"))) > 20
    assert "picture is a still" in opened_page.page.locator("#view0 .fallback").inner_text()
    assert opened_page.page.locator("#view0 [data-control=play]").is_hidden()


def test_page_prints_with_its_picture(opened):
    opened.page.emulate_media(media="print")
    settled(opened.page)
    assert opened.page.locator("#view0 [data-control=play]").is_hidden()
    assert len(opened.page.pdf()) > 50_000


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
