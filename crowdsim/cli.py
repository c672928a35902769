"""The commands; the only place that prints, catches and exits."""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim import __version__
from crowdsim.errors import CrowdsimError, OutputError

app = typer.Typer(
    name="crowdsim",
    help="Data-driven fight crowds: motion capture in, a trained crowd out.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]


def main() -> None:
    """Run the command line and leave with its exit code: 0 done, 1 failed, 2 invalid input, 130 or 143 interrupted."""
    signal.signal(signal.SIGTERM, _terminate)
    try:
        app(standalone_mode=True)
    except CrowdsimError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        # Whoever read standard output has gone; that is no failure of ours.
        sys.stderr.close()
        sys.exit(0)


def _terminate(number: int, frame: Any) -> None:
    print("terminated", file=sys.stderr)
    sys.exit(128 + number)


def _print_json(document: Any) -> None:
    print(json.dumps(document, indent=2, allow_nan=False))


class Bars:
    """Progress bars on standard error, one a stage: called with (stage, done, total)."""

    def __init__(self) -> None:
        self._stage = ""
        self._bar: Any = None

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Move the bar of a stage to ``done`` of ``total``."""
        from tqdm import tqdm

        if stage != self._stage:
            self.close()
            self._stage = stage
            self._bar = tqdm(total=total, desc=stage, file=sys.stderr, dynamic_ncols=True, mininterval=0.2)
        self._bar.total = total
        self._bar.update(done - self._bar.n)
        if done >= total:
            self.close()

    def close(self) -> None:
        """Finish the bar that is shown."""
        if self._bar is not None:
            self._bar.close()
            self._bar, self._stage = None, ""

    def __enter__(self) -> Bars:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"crowdsim {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    pass


@app.command()
def perform(
    seconds: Annotated[float, typer.Option(min=2.0, max=86400.0, help="Length of all clips together [s].")] = 437.0,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, another session.")] = 1,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the BVH files.")] = Path("output/performer"),
) -> None:
    """Write clips of the embedded boxer as BVH at 60 Hz."""
    from crowdsim.motion.performer import write_performance

    _make_folder(out)
    with Bars() as bars:
        paths = write_performance(out, seconds, seed, progress=bars)
    print(f"{len(paths)} clips in {out}")


@app.command()
def inspect(
    thing: Annotated[str, typer.Argument(help="A BVH file, a policy bundle or its name, or a run folder.")],
    as_json: Json = False,
    plots: Annotated[Path | None, typer.Option(help="Folder for pictures.")] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of a BVH file: m, cm, mm, inch, cmu or metres; found by default.")
    ] = None,
    up: Annotated[str | None, typer.Option(help="Up axis of a BVH file: y, z, -y ...; found by default.")] = None,
) -> None:
    """Tell what is in a BVH file, a trained policy or a run, and draw it."""
    path = Path(thing)
    _inspect_bvh(path, as_json, plots, unit, up)


def _inspect_bvh(path: Path, as_json: bool, plots: Path | None, unit: str | None, up: str | None) -> None:
    from crowdsim.motion.capture import load_capture
    from crowdsim.motion.report import describe_capture, study_capture

    capture = load_capture(path, unit, up)
    study = study_capture(capture)
    told = describe_capture(capture, study)
    if plots is not None:
        from crowdsim.motion.plots import plot_capture

        _make_folder(plots)
        for picture in plot_capture(capture, study, plots):
            print(picture, file=sys.stderr)
    if as_json:
        _print_json(told)
        return
    _print_capture(path, told)


def _print_capture(path: Path, told: dict[str, Any]) -> None:
    scale, height = told["unit_scale"], told["height_m"]
    print(f"{path}")
    print(f"  {told['joints']} joints, {told['end_sites']} end sites, {told['channels']} channels")
    print(f"  {told['frames']} frames at {told['fps']:g} a second, {told['seconds']:.2f} s")
    print(f"  unit {f'{scale:g} m' if scale else 'unknown'}, up axis {told['up_axis'] or 'unknown'}", end="")
    print(f", body {height:.2f} m tall" if height else "")
    for role, joint in told["roles"].items():
        print(f"    {role:15} {joint}")
    if told["contacts"] is not None:
        shares = " and ".join(f"{share:.0%}" for share in told["contact_share"])
        print(f"  lead-in of {told['lead_in_frames']} frames cut off; floor at {told['floor_m']:+.3f} m")
        print(f"  {told['contacts']} foot contacts, left and right foot planted {shares} of the time")
        print(f"  {told['strikes']} strikes, highest fist speed {told['highest_fist_speed']:.1f} m/s")
        for strike in told["strike_list"]:
            place = ", ".join(f"{value:+.2f}" for value in strike["place"])
            print(f"    {strike['seconds']:8.2f} s  {strike['hand']:5}  {strike['speed']:5.1f} m/s  at ({place})")
    for finding in told["findings"]:
        print(f"{path}: {finding}", file=sys.stderr)


def _make_folder(folder: Path) -> None:
    """Make a folder for outputs.

    Raises:
        OutputError: It cannot be made or is a file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder}: is a file, expected a folder to write into") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror}") from None
