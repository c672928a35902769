"""One run, from a scenario to its manifest: the only place where crowd, take, export and render meet."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdsim import assets
from crowdsim.crowd.scenario import Scenario, dump_scenario
from crowdsim.errors import CrowdsimError, OutputError, RunError
from crowdsim.manifest import NAME as MANIFEST
from crowdsim.manifest import peak_memory, read_manifest, write_manifest
from crowdsim.outputs import write_outputs
from crowdsim.run_folder import RESOLVED, TAKE, check_folder, clear_folder, copy_file, write_text
from crowdsim.take.take import VARIABLES, Cast, Events, Take
from crowdsim.validation import check_scenario

if TYPE_CHECKING:
    from crowdsim.crowd.crowd import Crowd
    from crowdsim.crowd.placement import Placed
    from crowdsim.crowd.script import Script
    from crowdsim.crowd.simulation import Chunk
    from crowdsim.crowd.statistics import CrowdStatistics
    from crowdsim.policy.policy import Policy

Array = NDArray[Any]
Progress = Callable[[str, int, int], None]

_TAKE_CHUNK_AVATAR_FRAMES = 4_000_000
_STEP_AVATAR_FRAMES = 200_000


class Interrupted(Exception):
    """A run was asked to stop; what it had done is kept and marked.

    Attributes:
        number: Number of the signal.
        folder: The run folder.
    """

    def __init__(self, number: int, folder: Path, kept: str) -> None:
        super().__init__(f"{folder}: interrupted; {kept}")
        self.number, self.folder = number, folder


@dataclass
class Report:
    """What a run did, for its summary and manifest.

    Attributes:
        folder: The run folder.
        seconds: Time of each stage [s].
        notes: What a user should know.
        done_before: Whether the run was finished already and has not been done again.
        statistics: The run in numbers.
        outputs: Files of each kind, and their size together [bytes].
    """

    folder: Path
    seconds: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    done_before: bool = False
    statistics: CrowdStatistics | None = None
    outputs: dict[str, tuple[Path, int, int]] = field(default_factory=dict)


@dataclass(frozen=True)
class Prepared:
    """A scenario ready to be run.

    Attributes:
        policies: Its policies.
        cast: What is constant for each avatar.
        crowd: The crowd before its first frame.
        script: What is planned.
        frames: Control frames.
        rate: Control frames a second.
    """

    policies: Sequence[Policy]
    cast: Cast
    crowd: Crowd
    script: Script
    frames: int
    rate: float


def load_policies(
    scenario: Scenario, mocap: Path | None = None, threads: int = 1, progress: Progress | None = None
) -> list[Policy]:
    """Return the policies that a scenario's types use, in the order of their types; trained when missing or stale.

    Args:
        scenario: The scenario, resolved.
        mocap: Folder of capture; by default that of the variable ``CROWDSIM_MOCAP``.
        threads: Threads for training.
        progress: Called with stage, done and total.

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
    capture = mocap or os.environ.get("CROWDSIM_MOCAP") or None
    # A bundle goes by the name that the scenario calls it, wherever it was trained.
    return [replace(ready_policy(name, capture, threads, progress), name=name) for name in names]


def prepare(scenario: Scenario, policies: Sequence[Policy], placed: Placed | None = None) -> Prepared:
    """Return a scenario with its policies, ready to be run.

    Raises:
        ScenarioError: Not all avatars fit, or a type weighs a behaviour that its policy has not learned.
        RunError: The policies' control rates differ.
    """
    from crowdsim.crowd.cast import cast_crowd
    from crowdsim.crowd.placement import place_groups

    rates = {policy.name: float(policy.database.control_rate) for policy in policies}
    if len(set(rates.values())) > 1:
        told = ", ".join(f"{name} has {rate:g}" for name, rate in rates.items())
        raise RunError(f"{scenario.name}: policies of one run need one control rate, but {told}")
    placed = placed or place_groups(scenario)
    crowd, script = cast_crowd(scenario, placed, policies)
    rate = next(iter(rates.values()))
    return Prepared(
        policies, build_cast(scenario, placed, policies), crowd, script, scenario.control_frames(rate), rate
    )


def build_cast(scenario: Scenario, placed: Placed, policies: Sequence[Policy]) -> Cast:
    """Return what is constant for each avatar."""
    from crowdsim.crowd.cast import policies_of_types

    kinds = list(scenario.types.values())
    owner = policies_of_types(scenario, policies)
    colours = [[np.nan] * 3 if kind.colour is None else _rgb(kind.colour) for kind in kinds]
    return Cast(
        names=np.array(scenario.avatar_names()),
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

    The command line runs by the same path, see ``run_to``, and gives the same take.

    Args:
        scenario: The scenario, resolved, as ``load_scenario`` gives it.
        policies: Its policies; found, and trained if need be, when None.
        threads: Threads; the take does not depend on them.
        mocap: Folder of capture for policies that are trained from it.
        order: Number of the avatar in each slot of storage at the start, which changes no result. Shape (N,).
        progress: Called with stage, done and total.

    Raises:
        ScenarioError: Not all avatars fit, or behaviours are weighed that are not learned.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
        RunError: The run failed.
    """
    from crowdsim.crowd.simulation import simulate

    placed = check_scenario(scenario) if policies is None else None
    chosen = load_policies(scenario, mocap, threads, progress) if policies is None else policies
    prepared = prepare(scenario, chosen, placed)
    chunks: list[Chunk] = []
    for chunk in simulate(prepared.crowd, prepared.policies, prepared.frames, prepared.script, threads, order=order):
        chunks.append(chunk)
        if progress is not None:
            progress("control", chunk.first + chunk.frames, prepared.frames)
    told = {name: np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in VARIABLES}
    events = {
        name: np.concatenate([getattr(chunk.events, name) for chunk in chunks]) for name in Events.__dataclass_fields__
    }
    events["frame"] = events["frame"].astype(np.float32)
    return Take(
        **told,
        cast=prepared.cast,
        targets=np.concatenate([chunk.targets for chunk in chunks]),
        target_names=tuple(scenario.targets),
        events=Events(**events),
        control_rate=prepared.rate,
        scenario=scenario.name,
        seed=scenario.seed,
        fingerprints=tuple(policy.fingerprint for policy in prepared.policies),
        status="done",
    )


@contextmanager
def _stop_signals() -> Iterator[list[int]]:
    """Collect the first SIGINT or SIGTERM instead of dying of it; a second one interrupts at once."""
    caught: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield caught
        return

    def note(number: int, _: Any) -> None:
        if caught:
            raise KeyboardInterrupt
        caught.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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

    A finished run of the same resolved scenario is not done again, unless ``force`` says so. What is wrong with the
    input is found before the folder is made or touched.

    Raises:
        ScenarioError: Not all avatars fit, or behaviours are weighed that are not learned.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
        OutputError: The folder cannot be used.
        RunError: The run failed, or an output cannot be written.
        Interrupted: SIGINT or SIGTERM came; the take holds the frames that were done.
    """
    report = Report(folder)
    clock = _Clock(report.seconds)
    resolved = dump_scenario(scenario)
    if check_folder(folder, resolved, force):
        report.done_before = True
        report.notes += _changed_policies(folder)
        return report
    placed = check_scenario(scenario)
    policies = load_policies(scenario, mocap, threads, progress)
    clock.lap("policies")
    prepared = prepare(scenario, policies, placed)
    clock.lap("prepare")
    with _stop_signals() as caught:
        report.notes += clear_folder(folder)
        try:
            _run_in(folder, scenario, prepared, resolved, threads, report, clock, command, caught, progress)
        except OutputError as error:
            # The folder was fit to be written when the run began, so its input was valid.
            raise RunError(str(error)) from error
    return report


def _run_in(
    folder: Path,
    scenario: Scenario,
    prepared: Prepared,
    resolved: str,
    threads: int,
    report: Report,
    clock: _Clock,
    command: str,
    caught: list[int],
    progress: Progress | None,
) -> None:
    """Write everything into a folder that is ready for it."""
    write_text(folder / RESOLVED, resolved)
    for name in scenario.files:
        copy_file(scenario.folder / name, folder / name)
    take, timings = _record(folder, scenario, prepared, threads, report, clock, caught, progress)

    def watch(stage: str, done: int, total: int) -> None:
        if caught:
            kept = "the take is finished and kept, outputs are not: export makes them, run --force does all again"
            raise Interrupted(caught[0], folder, kept)
        if progress is not None:
            progress(stage, done, total)

    files = write_outputs(folder, take, prepared.policies, scenario, threads, report.seconds, watch)
    clock.start()
    if timings is not None and scenario.outputs.profile is not None:
        from crowdsim.crowd.profile import write_profile

        write_profile(folder, timings, take.avatar_count, scenario.outputs.profile)
        clock.lap("profile")
    for kind, written in files.items():
        place = written[0].parent if kind in ("bvh", "ply", "pcd") else written[0]
        report.outputs[kind] = (place, len(written), sum(path.stat().st_size for path in written))
    watch("checksums", 0, 1)
    write_manifest(folder, _manifest(scenario, prepared, report, clock, command, threads), threads)
    watch("checksums", 1, 1)


class _Clock:
    """Adds the time since the last lap to stages."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self._seconds = seconds
        self._begun = self._since = perf_counter()

    def start(self) -> None:
        self._since = perf_counter()

    def lap(self, stage: str) -> None:
        now = perf_counter()
        self._seconds[stage] = self._seconds.get(stage, 0.0) + now - self._since
        self._since = now

    def total(self) -> float:
        return perf_counter() - self._begun


def _record(
    folder: Path,
    scenario: Scenario,
    prepared: Prepared,
    threads: int,
    report: Report,
    clock: _Clock,
    caught: list[int],
    progress: Progress | None,
) -> tuple[Take, Array | None]:
    """Simulate and write the take as it comes; return it, and what control cost where that is wanted."""
    from crowdsim.crowd.simulation import Simulation, simulate
    from crowdsim.crowd.statistics import StatisticsCounter
    from crowdsim.take.store import TakeWriter, open_take

    policies, cast, frames = prepared.policies, prepared.cast, prepared.frames
    profiled = scenario.outputs.profile is not None
    # One frame of a simulation of its own, so that compiling, or loading what was compiled, is no part of control.
    first = Simulation(prepared.crowd, policies, prepared.script, threads, profiled=profiled)
    first.run(1)
    first.close()
    clock.lap("compile")
    count = len(cast.names)
    rows = max(1, min(scenario.outputs.take.chunk, _TAKE_CHUNK_AVATAR_FRAMES // count))
    counter = StatisticsCounter(policies, cast.policies, cast.scales, frames)
    timings: list[Array] = []
    writer = TakeWriter(
        folder / TAKE, cast, frames, prepared.rate, scenario.name, scenario.seed,
        tuple(policy.fingerprint for policy in policies), tuple(scenario.targets), rows,
    )  # fmt: skip
    try:
        step = max(1, min(rows, _STEP_AVATAR_FRAMES // count))
        chunks = simulate(prepared.crowd, policies, frames, prepared.script, threads, profiled=profiled, chunk=step)
        clock.lap("take")
        for chunk in chunks:
            clock.lap("control")
            writer.append(chunk.variables(), chunk.events, chunk.targets)
            clock.lap("take")
            counter.add(chunk)
            if chunk.timings is not None:
                timings.append(chunk.timings)
            clock.lap("statistics")
            done = chunk.first + chunk.frames
            if progress is not None:
                progress("control", done, frames)
            if caught and done < frames:
                writer.close("interrupted")
                kept = f"the {done} of {frames} control frames that were done are kept, --force runs all again"
                raise Interrupted(caught[0], folder, kept)
            clock.start()
        writer.close()
    except BaseException:
        writer.abandon()
        raise
    take = open_take(folder / TAKE)
    size = sum(path.stat().st_size for path in (folder / TAKE).rglob("*") if path.is_file())
    report.outputs["take"] = (folder / TAKE, 1, size)
    report.statistics = counter.finish()
    clock.lap("take")
    return take, np.concatenate(timings) if timings else None


def _manifest(
    scenario: Scenario, prepared: Prepared, report: Report, clock: _Clock, command: str, threads: int
) -> dict[str, Any]:
    report.seconds["total"] = clock.total()
    statistics = report.statistics
    return {
        "status": "done",
        "scenario": scenario.name,
        "seed": scenario.seed,
        "command": command,
        "threads": threads,
        "avatars": len(prepared.cast.names),
        "control_frames": prepared.frames,
        "policies": {policy.name: policy.fingerprint for policy in prepared.policies},
        "statistics": {} if statistics is None else asdict(statistics),
        "seconds": {stage: round(value, 6) for stage, value in report.seconds.items()},
        "peak_memory_bytes": peak_memory(),
    }


def _changed_policies(folder: Path) -> list[str]:
    """Say which policies of a finished run have been trained otherwise since."""
    from crowdsim.policy.bundle import read_document

    notes = []
    for name, fingerprint in read_manifest(folder).get("policies", {}).items():
        try:
            now = read_document(assets.find_bundle(name))["fingerprint"]
        except CrowdsimError:
            continue
        if now != fingerprint:
            notes.append(f"{folder}: policy {name!r} has been trained again since; --force runs with it")
    return notes


def open_run(folder: Path) -> tuple[Take, list[Policy], list[str]]:
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
    if take.status != "done":
        notes.append(f"{folder}: the run was interrupted; {take.frame_count} control frames are there")
    elif not (folder / MANIFEST).exists():
        notes.append(f"{folder}: the run is not finished; its take is, some outputs may be missing")
    return take, policies, notes
