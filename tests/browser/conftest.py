"""A browser, and pages of small runs."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import _chromium

sys.path.pop()  # some benchmarks have names of packages of tests


@pytest.fixture(scope="session")
def chromium() -> str:
    """Path of Chromium; tests skip without it, and fail where CI should have had it."""
    found = _chromium.find()
    if found is not None:
        return found
    reason = "no Chromium was found; on Debian: apt-get install --no-install-recommends chromium"
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="module")
def browser(chromium: str) -> Iterator[_chromium.Browser]:
    """A browser that all tests of a file share; each opens its own page."""
    with _chromium.Browser() as found:
        yield found


def picture(browser: _chromium.Browser) -> np.ndarray:
    """What the canvas shows, without what lies over it. Shape (height, width, 3), 0 to 255."""
    browser.settle()
    browser.evaluate("document.querySelectorAll('header, #side').forEach(one => { one.style.display = 'none'; })")
    browser.evaluate("document.getElementById('overlay').style.display = 'none'")
    whole = screen(browser)
    browser.evaluate("document.querySelectorAll('header, #side, #overlay').forEach(one => { one.style.display = ''; })")
    height = round(browser.evaluate("document.getElementById('picture').clientHeight"))
    return whole[:height]


def screen(browser: _chromium.Browser) -> np.ndarray:
    """What the page shows. Shape (height, width, 3), 0 to 255."""
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(browser.screenshot())).convert("RGB")).astype(int)
