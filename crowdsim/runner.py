"""One run, from a scenario to its manifest: the only place where crowd, take, export and render meet."""

from __future__ import annotations

import difflib
import os
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdsim import assets
from crowdsim.crowd.scenario import Scenario, dump_scenario
from crowdsim.errors import OutputError, ScenarioError
from crowdsim.manifest import NAME as MANIFEST
from crowdsim.manifest import peak_memory, read_manifest, write_manifest
from crowdsim.take.take import VARIABLES, Cast, Events, Take

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

Array = NDArray[Any]
Progress = Callable[[str, int, int], None]

RESOLVED = "scenario.resolved.yaml"
TAKE = "take.zarr"
_OUTPUTS = (MANIFEST, RESOLVED, TAKE, "bvh", "ply", "pcd", "frames", "video.mp4", "contact_sheet.png")
_OUTPUTS_MORE = ("profile.csv", "profile.png")
_TAKE_CHUNK_AVATAR_FRAMES = 4_000_000


class Interrupted(Exception):
    """A run was asked to stop; what it had done is kept and marked.

    Attributes:
        number: Number of the signal.
        folder: The run folder.
    """

    def __init__(self, number: int, folder: Path) -> None:
        super().__init__(f"{folder}: interrupted; the frames that were done are kept, run it again with --force")
        self.number, self.folder = number, folder


@dataclass
class Report:
    """What a run did, for its summary and manifest.

    Attributes:
        folder: The run folder.
        seconds: Time of each stage [s].
        notes: What a user should know.
        done_before: Whether the run was finished already and has not been done again.
        control_frames: Control frames that were run.
        avatars: Number of avatars.
        strikes: Strikes thrown.
        landed: Strikes that landed.
        outputs: Number of files of each kind.
    """

    folder: Path
    seconds: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    done_before: bool = False
    control_frames: int = 0
    avatars: int = 0
    strikes: int = 0
    landed: int = 0
    outputs: dict[str, int] = field(default_factory=dict)


def load_policies(
    scenario: Scenario, mocap: Path | None = None, threads: int = 1, progress: Progress | None = None
) -> list[Policy]:
    """Return the policies that a scenario's types use, in the order of their types; trained when missing or stale.

    Raises:
        RecipeError: A recipe is invalid.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
    """
    from crowdsim.policy.train import ready_policy

    used: set[str] = set()
    for group in scenario.groups:
        used.update(
            [group.type] if group.type is not None else [name for name, share in (group.mix or {}).items() if share]
        )
    names = dict.fromkeys(kind.policy for name, kind in scenario.types.items() if name in used)
    return [ready_policy(name, mocap, threads, progress) for name in names]


def build_cast(scenario: Scenario, placed: Any, policies: Sequence[Policy]) -> Cast:
    """Return what is constant for each avatar."""
    from crowdsim.crowd.cast import policies_of_types

    kinds = list(scenario.types.values())
    owner = policies_of_types(scenario, policies)
    colours = [[np.nan] * 3 if kind.colour is None else _rgb(kind.colour) for kind in kinds]
    return Cast(
        names=np.array([scenario.avatar_name(number) for number in range(placed.count)]),
        types=placed.type.astype(np.int16),
        teams=placed.team.astype(np.int16),
        policies=owner[placed.type],
        scales=placed.scale.astype(np.float32),
        speeds=placed.speed.astype(np.float32),
        type_names=tuple(placed.types),
        team_names=tuple(placed.teams),
        policy_names=tuple(policy.name for policy in policies),
        colours=np.array(colours, float).reshape(-1, 3),
    )


def _rgb(colour: str) -> list[float]:
    return [int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5)]


def run(
    scenario: Scenario,
    policies: Sequence[Policy] | None = None,
    threads: int = 1,
    mocap: Path | None = None,
    order: Array | None = None,
    progress: Progress | None = None,
) -> Take:
    """Run a scenario in memory and return its take; nothing is written but policies that had to be trained.

    Args:
        scenario: The scenario, resolved, as ``load_scenario`` gives it.
        policies: Its policies; found, and trained if need be, when None.
        threads: Threads; the take does not depend on them.
        mocap: Folder of capture for policies that are trained from it.
        order: Storage place of each avatar at the start, which changes no result; shape (N,).
        progress: Called with stage, done and total.
    """
    chosen = load_policies(scenario, mocap, threads, progress) if policies is None else list(policies)
    parts: list[Any] = []
    cast: Cast | None = None
    for told_cast, chunk, frames in _simulate(scenario, chosen, threads, order, None):
        cast = told_cast
        parts.append(chunk)
        if progress is not None:
            progress("control", chunk.first + chunk.frames, frames)
    assert cast is not None
    told = {name: np.concatenate([getattr(part, name) for part in parts]) for name in VARIABLES}
    events = {name: np.concatenate([getattr(part.events, name) for part in parts]) for name in _event_names()}
    return Take(
        **told,
        cast=cast,
        targets=np.concatenate([part.targets for part in parts]),
        target_names=tuple(scenario.targets),
        events=Events(**events),
        control_rate=float(chosen[0].database.control_rate),
        scenario=scenario.name,
        seed=scenario.seed,
        fingerprints=tuple(policy.fingerprint for policy in chosen),
        status="done",
    )


def _event_names() -> list[str]:
    return list(Events.__dataclass_fields__)


def _simulate(
    scenario: Scenario, policies: Sequence[Policy], threads: int, order: Array | None, chunk: int | None,
    profiled: bool = False,
) -> Iterator[tuple[Cast, Any, int]]:  # fmt: skip
    """Yield the cast, the next chunk and the planned number of frames."""
    from crowdsim.crowd.cast import cast_crowd
    from crowdsim.crowd.placement import place_groups
    from crowdsim.crowd.simulation import simulate

    rate = float(policies[0].database.control_rate)
    frames = scenario.control_frames(rate)
    placed = place_groups(scenario)
    cast = build_cast(scenario, placed, policies)
    crowd, script = cast_crowd(scenario, placed, policies)
    for part in simulate(crowd, policies, frames, script, threads, order=order, profiled=profiled, chunk=chunk):
        yield cast, part, frames


@contextmanager
def _stop_signals() -> Iterator[list[int]]:
    """Collect SIGINT and SIGTERM instead of dying of them, so that a run can end at a frame's end."""
    caught: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield caught
        return

    def note(number: int, _: Any) -> None:
        caught.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def prepare_folder(folder: Path, resolved: str, force: bool, report: Report) -> bool:
    """Make a run folder ready, and say whether there is anything to do.

    Raises:
        OutputError: The path is a file, cannot be written, holds something that is no run, or holds another run; the
            message then shows how they differ.
    """
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder}: is a file, expected a folder for the run")
        folder.mkdir(parents=True, exist_ok=True)
        held = sorted(path.name for path in folder.iterdir())
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror or error}") from None
    if not os.access(folder, os.W_OK):
        raise OutputError(f"{folder}: cannot be written, expected a folder with write permission")
    ours = {*_OUTPUTS, *_OUTPUTS_MORE}
    known = [name for name in held if name in ours or name.endswith((".partial", ".part"))]
    if len(known) < len(held) and MANIFEST not in held and RESOLVED not in held:
        stranger = next(name for name in held if name not in known)
        raise OutputError(f"{folder}: holds {stranger!r}, which is no run's; expected an empty folder or a run's")
    if MANIFEST in held and not force:
        before = _read(folder / RESOLVED)
        if before == resolved and read_manifest(folder).get("status") == "done":
            report.done_before = True
            return False
        lines = difflib.unified_diff(
            before.splitlines(), resolved.splitlines(), "run there", "asked for", "", "", 0, ""
        )
        change = "\n".join(list(lines)[:40])
        raise OutputError(f"{folder}: holds another run; --force replaces it, --out names another folder\n{change}")
    if known and MANIFEST not in held:
        report.notes.append(f"{folder}: an unfinished run was found ({', '.join(known)}); starting clean")
    _clear(folder, known)
    return True


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError:
        return ""


def _clear(folder: Path, names: Sequence[str]) -> None:
    """Remove what an earlier run left, its manifest first so that it is never taken for done."""
    for name in sorted(names, key=lambda name: name != MANIFEST):
        path = folder / name
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
        except OSError as error:
            raise OutputError(f"{path}: cannot be replaced: {error.strerror or error}") from None


def run_to(
    folder: Path,
    scenario: Scenario,
    threads: int = 1,
    mocap: Path | None = None,
    force: bool = False,
    command: str = "",
    progress: Progress | None = None,
) -> Report:
    """Run a scenario into a folder: take, outputs, and the manifest last.

    A finished run of the same resolved scenario is not done again, unless ``force`` says so.

    Raises:
        OutputError: The folder cannot be used or an output cannot be written.
        Interrupted: SIGINT or SIGTERM came; the take holds the frames that were done.
    """
    report = Report(folder, avatars=scenario.avatar_count)
    resolved = dump_scenario(scenario)
    if not prepare_folder(folder, resolved, force, report):
        return report
    started = perf_counter()

    def lap(stage: str, since: float) -> float:
        now = perf_counter()
        report.seconds[stage] = report.seconds.get(stage, 0.0) + now - since
        return now

    policies = load_policies(scenario, mocap, threads, progress)
    since = lap("policies", started)
    write_text(folder / RESOLVED, resolved)
    from crowdsim.take.store import TakeWriter, open_take

    writer: TakeWriter | None = None
    timings: list[Array] = []
    wanted = scenario.outputs
    rows = max(1, min(wanted.take.chunk, _TAKE_CHUNK_AVATAR_FRAMES // max(1, scenario.avatar_count)))
    with _stop_signals() as caught:
        try:
            for cast, chunk, frames in _simulate(scenario, policies, threads, None, rows, wanted.profile is not None):
                since = lap("control", since)
                if writer is None:
                    writer = TakeWriter(
                        folder / TAKE,
                        cast,
                        frames,
                        float(policies[0].database.control_rate),
                        scenario.name,
                        scenario.seed,
                        tuple(policy.fingerprint for policy in policies),
                        tuple(scenario.targets),
                        rows,
                    )
                writer.append(chunk.variables(), chunk.events, chunk.targets)
                if chunk.timings is not None:
                    timings.append(chunk.timings)
                report.control_frames += chunk.frames
                report.strikes += len(chunk.events.frame)
                report.landed += int(np.count_nonzero(chunk.events.landed))
                since = lap("take", since)
                if progress is not None:
                    progress("control", report.control_frames, frames)
                if caught:
                    writer.close("interrupted")
                    raise Interrupted(caught[0], folder)
            assert writer is not None
            writer.close()
        except BaseException as error:
            if writer is not None and not isinstance(error, Interrupted):
                writer.abandon()
            raise
    since = lap("take", since)
    report.outputs["take"] = 1
    take = open_take(folder / TAKE)
    write_outputs(folder, take, policies, scenario, threads, report, progress)
    if timings and wanted.profile is not None:
        from crowdsim.crowd.profile import write_profile

        since = perf_counter()
        write_profile(folder, np.concatenate(timings), take.avatar_count, wanted.profile)
        lap("profile", since)
    report.seconds["total"] = perf_counter() - started
    write_manifest(
        folder,
        {
            "status": "done",
            "scenario": scenario.name,
            "seed": scenario.seed,
            "command": command,
            "avatars": take.avatar_count,
            "control_frames": take.frame_count,
            "policies": {policy.name: policy.fingerprint for policy in policies},
            "seconds": {stage: round(value, 6) for stage, value in report.seconds.items()},
            "peak_memory_bytes": peak_memory(),
            "threads": threads,
        },
    )
    return report


def write_text(path: Path, text: str) -> None:
    """Write a small file under a temporary name and rename it.

    Raises:
        OutputError: It cannot be written.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None


def write_outputs(
    folder: Path,
    take: Take,
    policies: Sequence[Policy],
    scenario: Scenario,
    threads: int,
    report: Report,
    progress: Progress | None = None,
) -> None:
    """Write the outputs that a scenario asks for from a take.

    Raises:
        OutputError: A file cannot be written.
    """
    from crowdsim.take.poses import PoseSampler

    wanted = scenario.outputs
    sampler = PoseSampler(take, policies, threads)
    if wanted.bvh is not None:
        from crowdsim.export.bvh import export_bvh

        since = perf_counter()
        bvh = wanted.bvh
        fps = bvh.fps or scenario.fps
        frames = check_range(take, fps, bvh.frames, "outputs.bvh.frames")
        report.outputs["bvh"] = len(export_bvh(sampler, folder / "bvh", fps, frames, bvh.avatars, progress))
        report.seconds["bvh"] = perf_counter() - since
    for kind in ("ply", "pcd"):
        cloud = getattr(wanted, kind)
        if cloud is None:
            continue
        from crowdsim.export.pointcloud import CloudBuilder, export_clouds

        since = perf_counter()
        fps = cloud.fps or scenario.fps
        frames = check_range(take, fps, cloud.frames, f"outputs.{kind}.frames")
        builder = CloudBuilder(sampler, fps, cloud.points, cloud.avatars)
        written = export_clouds(builder, folder / kind, kind, frames, cloud.every, threads, progress)
        report.outputs[kind] = len(written)
        report.seconds[kind] = perf_counter() - since
    if wanted.render is not None:
        from crowdsim.render.command import render_source
        from crowdsim.render.take_source import TakeSource

        since = perf_counter()
        options = render_options(wanted.render, threads)
        source = TakeSource(take, policies, wanted.render.fps, threads=threads)
        rendered = render_source(source, folder, options, progress)
        report.outputs["pictures"] = len(rendered.files)
        report.seconds["render"] = perf_counter() - since


def render_options(wanted: Any, threads: int) -> Any:
    """Return the options of the renderer that a scenario's ``outputs.render`` means."""
    from crowdsim.render.camera import Keys
    from crowdsim.render.command import RenderOptions

    camera = wanted.camera
    if not isinstance(camera, str):
        if camera.kind == "follow":
            camera = f"follow:{camera.avatar}"
        else:
            keys = camera.keys
            camera = Keys(
                np.array([key.seconds for key in keys]),
                np.array([key.position for key in keys]),
                np.array([key.look_at for key in keys]),
            )
    return RenderOptions(
        size=wanted.size,
        fps=None,
        frames=wanted.frames,
        camera=camera,
        mp4=wanted.mp4,
        png=wanted.png,
        contact_sheet=wanted.contact_sheet or 0,
        caption=wanted.caption,
        threads=threads,
    )


def check_range(take: Take, fps: float, frames: Sequence[int] | None, key: str) -> tuple[int, int] | None:
    """Return a range of output frames, cut to the take's.

    Raises:
        ScenarioError: It begins after the last frame.
    """
    if frames is None:
        return None
    count = take.output_frames(fps)
    if frames[0] >= count:
        raise ScenarioError(f"{key}: begins at frame {frames[0]}, the run has frames 0 to {count - 1} at {fps:g} fps")
    return frames[0], min(frames[1], count)


def open_run(folder: Path, threads: int = 1) -> tuple[Take, list[Policy], list[str]]:
    """Return a run's take, its policies, and what a user should know of it.

    Raises:
        TakeError: There is no take, or it is damaged.
        PolicyError: A policy is missing, or not the one it was recorded with.
    """
    from crowdsim.policy.bundle import read_bundle
    from crowdsim.take.store import open_take

    take = open_take(folder)
    policies = [read_bundle(assets.find_bundle(name)) for name in take.cast.policy_names]
    notes = []
    if take.status != "done" or not (folder / MANIFEST).exists():
        notes.append(f"{folder}: the run is not finished; {take.frame_count} control frames are there")
    return take, policies, notes
