"""The page of the player: one HTML document with its style, its program and a recording."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.resources import files
from itertools import chain
from os.path import lexists
from pathlib import Path
from typing import Any

from crowdsim.core.types import Progress
from crowdsim.errors import CrowdsimError, OutputError
from crowdsim.files import make_folder, open_plain, write_plain
from crowdsim.view.recording import Recording

GENERATOR = b'<meta name="generator" content="crowdsim view">'
"""By this line near its begin a page is known as one of the player."""
_BYTES, LARGEST = 60.0, 600e6
"""About how much an avatar takes in a frame, and the most that browsers load [bytes]."""
_SCRIPTS = (
    "data.js",
    "body.js",
    "coarsen.js",
    "camera.js",
    "draw.js",
    "marks.js",
    "panel.js",
    "why.js",
    "player.js",
    "live.js",
    "start.js",
)
"""The program, in the order in which its parts need one another."""


class Page(str):
    """The text of a page, which notebooks show as the page."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{html.escape(self)}" width="100%" height="640" style="border: 0"></iframe>'


def is_page(path: Path) -> bool:
    """Whether a file is a page of the player."""
    try:
        with open_plain(path.parent, path.name) as file:
            return GENERATOR in file.read(4096)
    except OSError:
        return False


def write_page(
    path: Path,
    recording: Recording,
    force: bool = False,
    threads: int = 1,
    progress: Progress | None = None,
    reasons: Mapping[str, Any] | None = None,
) -> int:
    """Write a page with a whole recording in it; return its size [bytes].

    Args:
        path: The file; its folder is made where it is missing.
        recording: The recording.
        force: Whether a page that is there may be replaced.
        threads: Threads.
        progress: Called with stage, done and total.
        reasons: Decisions (``why.describe_decision``) of some avatars by their numbers.

    Raises:
        OutputError: The file cannot be written, or something else has its name.
        CrowdsimError: The page would be too large.
    """
    if lexists(path):
        if not is_page(path):
            raise OutputError(f"{path}: is there already and no page of crowdsim view, expected another name")
        if not force:
            raise OutputError(f"{path}: is there already; --force replaces it")
    check_size(recording)
    make_folder(path.parent)
    write_plain(path.parent, path.name, page_parts(recording, threads, progress, reasons))
    return path.stat().st_size


def check_size(recording: Recording) -> None:
    """Refuse a recording that browsers could not load as one page.

    Raises:
        CrowdsimError: Its page would be too large.
    """
    size = _BYTES * recording.motion.avatars * recording.motion.frames
    if size > LARGEST:
        what = f"would have about {size / 1e9:.1f} GB, expected {LARGEST / 1e9:.1f} at most"
        raise CrowdsimError(f"the page {what}: fewer avatars (--avatars), frames (--frames) or frames a second (--fps)")


@cache
def asset(name: str) -> str:
    """Return the text of a file beside this one."""
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


@cache
def _program() -> str:
    parts = "\n".join(asset(name) for name in _SCRIPTS)
    return f"(() => {{\n'use strict';\n{parts}\n}})();\n"


def page_head(title: str, connects: str = "'none'") -> str:
    """Return a page up to where its recording begins.

    Its policy lets only this program and this style work, and nothing be fetched from anywhere.

    Args:
        title: Name of the recording.
        connects: What the page may connect to, as a content security policy says it.
    """
    style = asset("player.css")
    policy = (
        f"default-src 'none'; script-src {program_digest()}; style-src {digest(style)}; img-src data:; "
        f"connect-src {connects}; base-uri 'none'; form-action 'none'"
    )
    markup = asset("player.html")
    texts = {"policy": policy, "title": html.escape(title), "style": style}
    return re.sub(r"\{\{(\w+)\}\}", lambda found: texts[found[1]], markup)


def page_parts(
    recording: Recording,
    threads: int = 1,
    progress: Progress | None = None,
    reasons: Mapping[str, Any] | None = None,
) -> Iterator[bytes]:
    """Yield a page with a whole recording in it, part by part; arguments as of ``write_page``."""
    yield page_head(recording.name).encode()
    why = {} if reasons is None else {"why": reasons}
    with ThreadPoolExecutor(1) as pool:
        # Skins are made while blocks are posed, which come behind them.
        scene, blocks, early = pool.submit(recording.scene), recording.blocks(threads, progress), list[str]()
        for block in blocks:
            early.append(block)
            if scene.done():
                break
    yield embedded({"scene": base64.b64encode(scene.result()).decode("ascii"), **why}).encode()
    yield program().encode()
    for number, block in enumerate(chain(early, blocks)):
        yield f'<script type="text/plain" id="block-{number}">{block}</script>\n'.encode()


def embedded(document: Mapping[str, Any]) -> str:
    """Return the element that tells the program where its recording comes from."""
    text = json.dumps(document).replace("<", "\\u003c")
    return f'<script type="application/json" id="source">{text}</script>\n'


def program() -> str:
    """Return the element of the program, which begins to work at once."""
    return f"<script>{_program()}</script>\n"


def digest(text: str) -> str:
    """Return a text's checksum as a content security policy has it."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}'"


def program_digest() -> str:
    """Return the checksum of the program."""
    return digest(_program())
