"""The player: size of pages, seconds to write them, error of joints, and how soon and how fast Chromium shows them.

    python benchmarks/view.py [--json] [--quick]

``brawl_30`` whole at 60 frames a second, and runs of it with 1,000 and 10,000 boxers at the same density. ``seconds``
is what a page costs beyond posing, which is done alone before (``posing_seconds``). ``error_millimetres`` is the
greatest distance of a joint from where the poses have it.

Pages are shown by Chromium without a window at 1280 x 720, with graphics drawn in software (SwiftShader) on the
processors that all else shares: a machine with graphics hardware is many times faster. ``first_picture_seconds`` is
from the start of the browser's process with a new profile to the first picture, the best of several;
``frame_milliseconds`` is the median of the time between pictures while the recording plays, once resolution and detail
have adapted. Both are null where there is no Chromium.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from _chromium import JOINTS, Browser, find
from _quick import small_policies

from crowdsim.crowd.profiling import with_avatars
from crowdsim.preparation.prepare import load_policies
from crowdsim.runs.recorded import RecordedRun
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario
from crowdsim.view.page import page_parts
from crowdsim.view.recording import Recording

THREADS = min(2, os.cpu_count() or 1)
CROWDS = {"30": (30, None, 60.0), "1000": (1000, 10.0, 30.0), "10000": (10_000, 1.0, 30.0)}
"""Boxers, seconds (the whole scenario when None) and frames a second of each page."""
QUICK = {"30": (3, 1.0, 30.0), "1000": (6, 0.5, 30.0), "10000": (9, 0.5, 30.0)}
ADAPTING, PLAYING = 8.0, 6.0
"""For how long a page plays before it is measured, and while it is [s]."""


def boxers(count: int, seconds: float | None) -> RecordedRun:
    """Return a run of ``brawl_30`` with this many boxers, as dense as there."""
    scenario = load_scenario("brawl_30")
    if count != 30:
        scenario = with_avatars(scenario, count)
    policies = load_policies(scenario, threads=THREADS)
    if seconds is not None:
        frames = int(np.ceil(seconds * float(policies[0].database.control_rate)))
        scenario = scenario.model_copy(update={"duration": frames})
    return run(scenario, policies, threads=THREADS)


def posing(recording: Recording) -> float:
    """Return how long posing alone takes [s]."""
    started = time.perf_counter()
    motion = recording.motion
    for start in range(0, motion.frames, recording.block_frames):
        motion.poses(start, min(start + recording.block_frames, motion.frames))
    return time.perf_counter() - started


def write(recording: Recording, path: Path) -> float:
    """Write a page; return how long that takes [s]."""
    started = time.perf_counter()
    with open(path, "wb") as file:
        for part in page_parts(recording, THREADS):
            file.write(part)
    return time.perf_counter() - started


def joint_error(browser: Browser, recorded: RecordedRun, fps: float) -> float:
    """Return how far a joint of the page is at most from where the poses have it, at some frames [mm]."""
    frames = np.unique(np.linspace(0, recorded.output_frames(fps) - 1, 40).astype(int))
    worst = 0.0
    for frame in frames.tolist():
        shown = np.array(browser.evaluate(JOINTS.replace("FRAME", str(frame))))
        (poses,) = recorded.sampler.sample(frame, frame + 1, fps)
        worst = max(worst, float(np.linalg.norm(shown - poses.joints()[0][0], axis=-1).max()))
    return 1e3 * worst


def first_picture(page: Path) -> float:
    """Return how long it takes from the start of a browser to the first picture of a page [s]."""
    started = time.perf_counter()
    with Browser() as browser:
        browser.open(page)
        browser.wait("document.documentElement?.dataset.state === 'shown'")
        return time.perf_counter() - started


def frame_time(browser: Browser, seconds: tuple[float, float]) -> float:
    """Return the median of the time between pictures of a page that plays [ms]."""
    browser.evaluate(
        "crowdsimPlayer.play(true); globalThis.gaps = []; let last = 0;"
        "(function tick(now) { if (last) gaps.push(now - last); last = now; requestAnimationFrame(tick); })(0)"
    )
    time.sleep(seconds[0])
    browser.evaluate("gaps.length = 0")
    time.sleep(seconds[1])
    return float(np.median(browser.evaluate("gaps")[1:]))


def measure(quick: bool) -> dict[str, Any]:
    """Return the figures of all pages."""
    outcome: dict[str, Any] = {"renderer": None, "pages": {}}
    has_browser = find() is not None
    with tempfile.TemporaryDirectory() as folder:
        for name, (count, seconds, fps) in (QUICK if quick else CROWDS).items():
            page = Path(folder) / f"{name}.html"
            recorded = boxers(count, seconds)
            recording = recorded.recording(fps=fps, threads=THREADS)
            recording.motion.poses(0, min(8, recording.motion.frames))
            spent = posing(recording)
            row: dict[str, Any] = {"posing_seconds": spent}
            started = time.perf_counter()
            recording = recorded.recording(fps=fps, threads=THREADS)
            row["seconds"] = max(0.0, time.perf_counter() - started + write(recording, page) - spent)
            row["megabytes"] = page.stat().st_size / 1e6
            row |= dict.fromkeys(("first_picture_seconds", "frame_milliseconds", "error_millimetres"))
            if has_browser:
                row["first_picture_seconds"] = min(first_picture(page) for _ in range(1 if quick else 3))
                with Browser() as browser:
                    browser.shown(page)
                    if name == "30":
                        row["error_millimetres"] = joint_error(browser, recorded, fps)
                        outcome["renderer"] = browser.evaluate(
                            "(() => { const { gl } = crowdsimPlayer.painter;"
                            "const names = gl.getExtension('WEBGL_debug_renderer_info');"
                            "return gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER); })()"
                        )
                    row["frame_milliseconds"] = frame_time(browser, (0.2, 1.0) if quick else (ADAPTING, PLAYING))
            outcome["pages"][name] = row
    return outcome


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true", help="seconds: few boxers, a small policy")
    options = parser.parse_args()
    with small_policies() if options.quick else nullcontext():
        outcome = measure(options.quick)
    if options.json:
        print(json.dumps(outcome, indent=2))
        return
    print(f"pages of the player, {THREADS} threads; {outcome['renderer'] or 'no Chromium'}")
    for name, row in outcome["pages"].items():
        shown = "".join(
            f"{row[key]:>9.2f} {unit}" if row[key] is not None else f"{'-':>9} {unit}"
            for key, unit in (
                ("megabytes", "MB"), ("posing_seconds", "s posing"), ("seconds", "s beyond"),
                ("first_picture_seconds", "s to the first picture"), ("frame_milliseconds", "ms a frame"),
                ("error_millimetres", "mm"),
            )
        )  # fmt: skip
        print(f"  {int(name):>6,} boxers{shown}")


if __name__ == "__main__":
    main()
