"""The player: size of pages, error of joints, how soon and how fast Chromium shows them, and what is played live.

    python benchmarks/view.py [--json] [--quick]

``brawl_30`` whole at 60 frames a second, and runs of it with 1,000 and 10,000 boxers at the same density. ``seconds``
is what a page costs beyond posing, which is done alone before (``posing_seconds``), where no skins are kept from pages
before it. ``error_millimetres`` is the greatest distance of a joint from where the poses have it.

Pages are shown by Chromium without a window at 1280 x 720, with graphics drawn in software (SwiftShader) on the
processors that all else shares: a machine with graphics hardware is many times faster. ``first_picture_seconds`` is
from the start of the browser's process with a new profile to the first picture, the best of several;
``frame_milliseconds`` is the median of the time between pictures while the recording plays, once resolution and detail
have adapted. Both are null where there is no Chromium.

``play`` is ``brawl_30`` live. ``control_milliseconds`` and ``pose_milliseconds`` are medians of a control frame, of
which there are 15 a second: simulating it, and posing it for the page. With the page open, ``core_share`` is the share
of a core that the process of ``crowdsim play`` takes, ``frames_per_second`` what arrives of it. ``drag_to_picture_ms``
is the time from a movement of the mouse that drags a target, in the scene of one boxer, to the end of drawing the first
picture that shows it: the page reads a pixel of it, which waits for the drawing, as ``gl.finish()`` does not in
Chromium. It is the median; 95 % are within ``drag_to_picture_95_ms``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import psutil
from _chromium import JOINTS, Browser, find
from _quick import small_policies

from crowdsim.body import skin
from crowdsim.crowd.profiling import with_avatars
from crowdsim.play.session import Session
from crowdsim.preparation.prepare import load_policies
from crowdsim.runs.recorded import RecordedRun
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario
from crowdsim.view.live import LivePoses
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


@contextmanager
def no_skins() -> Iterator[None]:
    """Let no skin be kept, in memory or in the user's cache."""
    skin._skins.clear()
    with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, XDG_CACHE_HOME=folder):
        yield


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
    # A page on a busy machine may show none for a while.
    browser.wait("gaps.length > 1")
    return float(np.median(browser.evaluate("gaps")[1:]))


def live_costs(frames: int) -> dict[str, float]:
    """Return what control frames of ``brawl_30`` cost while it is played [ms]."""
    scenario = load_scenario("brawl_30")
    session = Session(scenario, load_policies(scenario, threads=THREADS))
    poses, spent = LivePoses(session.crowd), []
    for _ in range(frames):
        started = time.perf_counter()
        poses.add(session.step())
        stepped = time.perf_counter()
        if poses.shown >= 0:
            poses.poses()
            spent.append((stepped - started, time.perf_counter() - stepped))
    session.close()
    control, posed = 1e3 * np.median(spent[len(spent) // 4 :], axis=0)
    return {"control_milliseconds": float(control), "pose_milliseconds": float(posed)}


@contextmanager
def played(name: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Play a scenario or policy in a process of its own; yield it and the address of its page."""
    command = [sys.executable, "-m", "crowdsim.cli", "play", name, "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.terminate()


def live_shares(seconds: float) -> dict[str, float]:
    """Return the share of a core that ``brawl_30`` takes while it is played, and the frames a second that arrive."""
    with played("brawl_30") as (process, address), Browser() as browser:
        browser.shown(address)
        browser.wait("crowdsimPlayer.recording.latest > 15")
        times = psutil.Process(process.pid)
        used, first = (
            sum(times.cpu_times()[:2]),
            browser.evaluate("[performance.now(), crowdsimPlayer.recording.latest]"),
        )
        time.sleep(seconds)
        more, last = (
            sum(times.cpu_times()[:2]),
            browser.evaluate("[performance.now(), crowdsimPlayer.recording.latest]"),
        )
        passed = (last[0] - first[0]) / 1e3
        return {"core_share": (more - used) / passed, "frames_per_second": (last[1] - first[1]) / passed}


def drag_times(policy: str, moves: int) -> dict[str, float]:
    """Return how long it takes from a movement of the mouse to the picture that shows where the target is then [ms]."""
    with played(policy) as (_, address), Browser() as browser:
        browser.shown(address)
        browser.wait("crowdsimPlayer.recording.latest > 15")
        browser.evaluate(
            "globalThis.waits = []; globalThis.moved = 0;"
            "document.getElementById('picture').addEventListener('pointermove', event => {"
            " if (event.buttons && !moved) moved = event.timeStamp; });"
            "(() => { const player = crowdsimPlayer, real = player.tell.bind(player);"
            " const { gl } = player.painter, pixel = new Uint8Array(4);"
            " player.tell = () => { real(); if (!moved) return;"
            " gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);"
            " waits.push(performance.now() - moved); moved = 0; }; })()"
        )
        x, y = browser.evaluate(
            "crowdsimPlayer.view.project(...crowdsimPlayer.crowd.targets("
            "crowdsimPlayer.crowd.around(crowdsimPlayer.time * crowdsimPlayer.scene.fps))[0]).slice(0, 2)"
        )
        browser.drag((x, y), (x - 160, y + 60), moves)
        waits = browser.evaluate("waits")
        times = {"drag_to_picture_ms": np.median(waits), "drag_to_picture_95_ms": np.quantile(waits, 0.95)}
        return {name: float(value) for name, value in times.items()}


def measure_play(quick: bool, has_browser: bool) -> dict[str, Any]:
    """Return the figures of what is played live."""
    outcome: dict[str, Any] = live_costs(20 if quick else 400)
    outcome |= dict.fromkeys(("core_share", "frames_per_second", "drag_to_picture_ms", "drag_to_picture_95_ms"))
    if has_browser:
        outcome |= live_shares(1.0 if quick else PLAYING)
        outcome |= drag_times("boxer", 10 if quick else 120)
    return outcome


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
            with no_skins():
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
    outcome["play"] = measure_play(quick, has_browser)
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
    play = outcome["play"]
    control, posed = play["control_milliseconds"], play["pose_milliseconds"]
    print(f"played live, {control:.2f} ms control and {posed:.1f} ms poses a frame")
    if play["core_share"] is not None:
        print(f"  {play['core_share']:.0%} of a core at {play['frames_per_second']:.1f} frames a second")
        print(f"  {play['drag_to_picture_ms']:.0f} ms from a drag to the picture, ", end="")
        print(f"95 % within {play['drag_to_picture_95_ms']:.0f} ms")


if __name__ == "__main__":
    main()
