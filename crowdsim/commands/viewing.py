"""The command ``view``."""

from __future__ import annotations

import ipaddress
import os
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdsim.commands.common import (
    Force,
    Frames,
    Host,
    NoOpen,
    Port,
    Threads,
    detail,
    fps_option,
    note,
    say,
    size_text,
)
from crowdsim.commands.process import opened_run
from crowdsim.commands.progress import Bars
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError

if TYPE_CHECKING:
    from crowdsim.play.repeated import Repeated
    from crowdsim.runs.recorded import RecordedRun
    from crowdsim.view.recording import Recording
    from crowdsim.view.server import Server


def view(
    thing: Annotated[Path, typer.Argument(metavar="RUN|FILE.bvh|DIR", help="A run, its archive, or BVH files.")],
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write one page that needs no server and no network.")
    ] = None,
    avatars: Annotated[
        str | None,
        typer.Option(metavar="AVATARS", help="Numbers or names of avatars: 0-9 or 0,3,red_1; all by default."),
    ] = None,
    frames: Frames = None,
    fps: Annotated[float | None, fps_option("Frames a second; 60, or a BVH file's own, by default")] = None,
    port: Port = None,
    host: Host = None,
    no_open: NoOpen = False,
    why: Annotated[
        str | None,
        typer.Option(metavar="AVATARS", help="With --html: why these avatars do what they do; the run is repeated."),
    ] = None,
    threads: Threads = CORES,
    force: Force = False,
) -> None:
    """Play a run or BVH files in the browser, from a small server or as one page to send."""
    from crowdsim.compilation import watch_compilation

    served = {"--port": port, "--host": host}
    if html is not None and any(value is not None for value in served.values()):
        which = next(name for name, value in served.items() if value is not None)
        raise CrowdsimError(f"{which} has no effect on --html, expected one of them")
    if html is None and force:
        raise CrowdsimError("--force has no effect without --html")
    if html is None and why is not None:
        raise CrowdsimError("--why has no effect without --html: the server finds out why when it is asked")
    with _recording(thing, avatars, frames, fps, threads) as (recording, run):
        if html is not None:
            from crowdsim.view.page import write_page

            with Bars() as bars, watch_compilation(bars.note, ["pictures"], threads):
                reasons = None if why is None else _reasons(run, recording, avatars, why, threads)
                size = write_page(html, recording, force, threads, bars, reasons)
            say(f"{html}: {size_text(size)}")
        else:
            from crowdsim.view.server import LOOPBACK, open_server

            repeated = None if run is None else _repeated(run, threads)
            server = open_server(recording, host or LOOPBACK, port or 0, repeated)
            serve(server, host, not no_open)


@contextmanager
def _recording(
    thing: Path, avatars: str | None, frames: str | None, fps: float | None, threads: int
) -> Iterator[tuple[Recording, RecordedRun | None]]:
    """Yield what is played, and the run that it is of, if it is of one."""
    from crowdsim.view.bvh_motion import is_bvh, parse_people, record_bvh

    if is_bvh(thing):
        recording, findings = record_bvh(thing, fps, frames, parse_people(avatars))
        for line in findings:
            note(f"{thing}: {line}")
        yield recording, None
        return
    from crowdsim.runs.opening import open_run
    from crowdsim.runs.recorded import VIEW_FPS

    with opened_run(thing) as folder:
        run = open_run(folder)
        for line in run.notes:
            note(line)
        yield run.recording(avatars, frames, fps or VIEW_FPS, threads), run


def _repeated(run: RecordedRun, threads: int) -> Repeated | None:
    """Return what knows why avatars of a run did what they did; None where its scenario is not there any more."""
    from crowdsim.play.repeated import Repeated

    try:
        return Repeated(run, threads)
    except CrowdsimError as error:
        detail(f"why avatars do what they do is not known: {error}")
        return None


def _reasons(
    run: RecordedRun | None, recording: Recording, avatars: str | None, why: str, threads: int
) -> dict[str, list[dict[str, Any]]]:
    """Return the decisions of some avatars of a recording by their numbers."""
    from crowdsim.export.select import parse_avatars
    from crowdsim.play.repeated import Repeated

    if run is None:
        raise CrowdsimError("--why has no effect on BVH files, whose figures decide nothing")
    numbers, shown = parse_avatars(why, run.cast) or [], parse_avatars(avatars, run.cast)
    absent = [] if shown is None else sorted(set(numbers) - set(shown))
    if absent:
        raise CrowdsimError(f"--why names avatar {absent[0]}, expected some of --avatars {avatars}")
    first, fps = recording.motion.first, recording.motion.fps
    begin, end = (int(frame / fps * run.control_rate) for frame in (first, first + recording.motion.frames))
    found: dict[str, list[dict[str, Any]]] = {str(number): [] for number in numbers}
    for decision in Repeated(run, threads).all(numbers, begin, end):
        found[str(decision["avatar"])].append(decision)
    return found


def serve(server: Server, host: str | None, opens: bool) -> None:
    """Answer requests until a signal comes; print the address, and open it in a browser.

    Args:
        server: The server.
        host: Where it listens, as the user says; this machine when None.
        opens: Whether a browser is opened.
    """
    if host is not None and not _is_loopback(host):
        note(f"warning: whoever reaches this machine at {host} and has the address sees this; it is not encrypted")
    # The address is the result, also where nothing else is said.
    print(server.address, flush=True)
    note("Ctrl-C ends it")
    if opens and not _open_browser(server.address):
        note("no browser could be opened: open the address in one")
    server.serve()


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _open_browser(address: str) -> bool:
    """Open a browser with a window; whether there is one."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False
