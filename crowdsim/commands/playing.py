"""The command ``play``."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from crowdsim.commands.common import Host, Mocap, NoOpen, Port, Threads, complete_either, note, say
from crowdsim.commands.progress import Bars
from crowdsim.commands.viewing import serve
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError, OutputError, ScenarioError
from crowdsim.files import remove_tree

if TYPE_CHECKING:
    from crowdsim.play.session import Session
    from crowdsim.policy.policy import Policy
    from crowdsim.scenario.scenario import Scenario


_MANY = 150
"""Most avatars that are posed in the time of a control frame, about."""


def play(
    thing: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO|POLICY",
            help="A scenario, or a policy: one boxer and a target to drag.",
            autocompletion=complete_either,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Run folder that is recorded into; further ones have a number behind."),
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", min=0, help="Another seed.")] = None,
    override: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Another value, groups[0].count=12 say.")
    ] = None,
    port: Port = None,
    host: Host = None,
    no_open: NoOpen = False,
    paused: Annotated[bool, typer.Option("--paused", help="Begin paused.")] = False,
    threads: Threads = CORES,
    mocap: Mocap = None,
) -> None:
    """Play a scenario live in the browser, and interfere: drag targets, tune types, take avatars out; record it."""
    from crowdsim.compilation import watch_compilation
    from crowdsim.jit.environment import load_numba
    from crowdsim.play.session import Session
    from crowdsim.runs.folder import check_folder
    from crowdsim.view.server import LOOPBACK, listen, server_at
    from crowdsim.view.stage import Stage

    scenario, name = _scenario(thing, seed, override or [])
    folder = out or Path("output") / name
    # What would be wrong with either shows before anything is trained or drawn.
    check_folder(free_folder(folder), "", False)
    with listen(host or LOOPBACK, port or 0) as listening:
        load_numba()
        if scenario.avatar_count > _MANY:
            count = f"{scenario.avatar_count:,} avatars"
            note(f"{count} cannot be posed in real time: they will be slower; --set gives fewer")
        command = shlex.join(["crowdsim", *sys.argv[1:]])
        policies = _policies(scenario, mocap, threads)
        with Bars() as bars, watch_compilation(bars.note):
            session = Session(scenario, policies, threads)
            if scenario.avatar_count <= _MANY:
                # Compiled now, it does not stop the scene when someone asks why.
                session.explain()

        safe: list[Path] = []

        def record() -> str:
            # A signal may end the process before the run is written.
            safe.append(_write(session, folder))
            place = free_folder(folder)
            try:
                session.record(place, command)
            finally:
                kept = safe.pop()
                remove_tree(kept.parent, kept.name)
            say(f"{place}: recorded, {session.frame} control frames")
            return f"Recorded as {place}."

        stage = Stage(session, record, lambda: _keep(session, folder))
        stage.pause(paused)
        server = server_at(listening, stage, host or LOOPBACK)
        stage.start()
        try:
            serve(server, host, not no_open)
        finally:
            for kept in safe:
                note(
                    f"it is still being recorded; until that is done, {kept / 'scenario.yaml'} repeats what was played"
                )
            # A long step must not keep what was played from being written.
            ended = stage.close()
            _keep(session, folder)
            if ended:
                session.close()


def _scenario(thing: str, seed: int | None, overrides: list[str]) -> tuple[Scenario, str]:
    """Return the scenario of this name, or that of a policy and a target, and the name of the run folder."""
    from crowdsim.assets import find_scenario, policy_names
    from crowdsim.play.session import boxer_and_target
    from crowdsim.scenario.scenario import load_scenario

    path = Path(thing)
    is_policy = path.stem in policy_names() and (len(path.parts) == 1 or path.parent.name == "policies")
    if not is_policy and not (path / "policy.json").is_file():
        try:
            find_scenario(thing)
        except ScenarioError as error:
            raise ScenarioError(f"{error}; or a policy, one of {', '.join(policy_names())}") from None
        scenario = load_scenario(thing, overrides, seed)
        return scenario, f"{scenario.name}_played"
    scenario = load_scenario(boxer_and_target(path.stem if is_policy else thing), overrides, seed)
    return scenario, scenario.name


def _policies(scenario: Scenario, mocap: Path | None, threads: int) -> list[Policy]:
    from crowdsim.preparation.prepare import load_policies, training_notice, untrained_policies
    from crowdsim.preparation.validation import check_scenario

    check_scenario(scenario)
    with Bars() as bars:
        for name in untrained_policies(scenario, mocap):
            bars.note(training_notice(name, threads))
        return load_policies(scenario, mocap, threads, bars)


def free_folder(folder: Path) -> Path:
    """Return a folder that is not there yet: this one, or with the first number behind that is free."""
    place, number = folder, 1
    while place.exists():
        number += 1
        place = folder.with_name(f"{folder.name}_{number}")
    return place


def _keep(session: Session, folder: Path) -> str:
    """Write the scenario of what was played and not recorded, if anything was done; return a sentence on it."""
    if not session.is_changed:
        return ""
    place = _write(session, folder)
    note(f"what was played is kept: crowdsim run {shlex.quote(str(place / 'scenario.yaml'))} repeats it")
    return f"What was played is kept in {place}."


def _write(session: Session, folder: Path) -> Path:
    """Write the scenario of what was played beside a run folder, and return where."""
    place = free_folder(folder.with_name(f"{folder.name}_session"))
    try:
        session.keep(place)
    except (CrowdsimError, OSError) as error:
        raise OutputError(f"{place}: what was played could not be kept: {error}") from None
    return place
