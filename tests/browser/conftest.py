"""A real browser for pages: Chromium without a screen, drawing in software.

Errors and requests of each page are recorded for the tests.
"""

import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

import pytest

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)
FLAGS = (
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--disable-quic", "--disable-default-apps"),
)
HERE = ("", "127.0.0.1", "localhost")  # hosts of a request on this machine
LOCAL_SCHEMES = ("file", "data", "blob", "about")


@dataclass(slots=True)
class Watched:
    """A page with its errors and requests."""

    page: Any
    errors: list[str] = field(default_factory=list)  # of the console, and exceptions
    requests: list[str] = field(default_factory=list)  # addresses

    def outside(self) -> list[str]:
        """Addresses that are not of this machine."""
        addresses = [one for one in self.requests if urlsplit(one).scheme not in LOCAL_SCHEMES]
        return [one for one in addresses if urlsplit(one).hostname not in HERE]


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium; a test is skipped where there is none, unless PALPATE_BROWSER demands it."""
    if not CHROMIUM:
        if os.environ.get("PALPATE_BROWSER") == "required":
            pytest.fail("PALPATE_BROWSER=required, but no Chromium is on the path")
        pytest.skip("needs Chromium: on Debian or Ubuntu, apt install chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS])
        yield chromium
        chromium.close()


@pytest.fixture
def open_page(browser: Any) -> Iterator[Callable[..., Watched]]:
    """Function that opens an address in a new page of a width and height [pixels]."""
    opened: list[Any] = []

    def open_address(address: str, width: int = 1280, height: int = 800, **how: Any) -> Watched:
        page = browser.new_page(viewport={"width": width, "height": height}, **how)
        opened.append(page)
        watched = Watched(page)
        page.on("console", lambda line: line.type == "error" and watched.errors.append(line.text))
        page.on("pageerror", lambda error: watched.errors.append(str(error)))
        page.on("request", lambda request: watched.requests.append(request.url))
        page.goto(address)
        return watched

    yield open_address
    for page in opened:
        page.close()
