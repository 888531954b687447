"""A real browser for pages: Chromium without a screen, drawing in software.

What a page prints as an error and what it asks of the network is kept, for tests to look at.
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
HERE = ("", "127.0.0.1", "localhost")  # Hosts of a request that leaves nobody's machine
LOCAL_SCHEMES = ("file", "data", "blob", "about")


@dataclass(slots=True)
class Watched:
    """A page that is watched."""

    page: Any
    errors: list[str] = field(default_factory=list)  # Of the console, and exceptions
    requests: list[str] = field(default_factory=list)  # Addresses

    def outside(self) -> list[str]:
        """Addresses that are not of this machine."""
        return [one for one in self.requests if not _is_local(one)]


def _is_local(address: str) -> bool:
    parts = urlsplit(address)
    return parts.scheme in LOCAL_SCHEMES or parts.hostname in HERE


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
    """Opens an address in a page of its own, of a width and height in pixels."""
    opened: list[Any] = []

    def do(address: str, width: int = 1280, height: int = 800, **how: Any) -> Watched:
        page = browser.new_page(viewport={"width": width, "height": height}, **how)
        opened.append(page)
        found = Watched(page)
        page.on("console", lambda one: one.type == "error" and found.errors.append(one.text))
        page.on("pageerror", lambda one: found.errors.append(str(one)))
        page.on("request", lambda one: found.requests.append(one.url))
        page.goto(address)
        return found

    yield do
    for page in opened:
        page.close()
