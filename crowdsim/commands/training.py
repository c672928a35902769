"""The command ``train``, and the summary that it ends with."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.commands.common import (
    Force,
    Json,
    Mocap,
    Threads,
    complete_recipe,
    detail,
    note,
    print_json,
    say,
    talk,
)
from crowdsim.commands.policy_text import duel_text, falls_text
from crowdsim.commands.progress import Bars
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError, MotionError, RunError


def train(
    recipe: Annotated[
        str | None,
        typer.Argument(
            metavar="[RECIPE]", help="A recipe's file, or its name; none with --name.", autocompletion=complete_recipe
        ),
    ] = None,
    mocap: Mocap = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Write a recipe for all BVH files of --mocap, in any layout, and train it."),
    ] = None,
    behaviours: Annotated[
        str | None, typer.Option(metavar="NAMES", help="With --name: approach, punch, fight or some of them.")
    ] = None,
    threads: Threads = CORES,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Train a policy from motion capture or from the embedded boxer, and sum up what came of it."""
    from crowdsim import assets
    from crowdsim.compilation import watch_compilation
    from crowdsim.policy.bundle import read_document, read_timings
    from crowdsim.preparation.prepare import shared_bundle, table_type_of
    from crowdsim.self_play.train import train_recipe
    from crowdsim.training.summary import summarise
    from crowdsim.training.train import is_trained

    _check_options(recipe, name, behaviours)
    written = None if name is None else _write_recipe(name, mocap, behaviours)
    chosen = str(written or recipe)
    try:
        capture = None if written else mocap
        shared = None if force else shared_bundle(chosen, capture)
        trains = force or (shared is None and not is_trained(chosen, capture))
        uses = ["training", f"few {table_type_of([chosen])}"] if trains else []
        with Bars() as bars, watch_compilation(bars.note, uses, threads) as compilation:
            folder, trained = (shared, False) if shared else train_recipe(chosen, capture, threads, force, bars)
    except MotionError as error:
        if written is None:
            raise
        raise RunError(f"{error}\n{written} is kept; change it and go on with: crowdsim train {name}") from error
    document, timings = read_document(folder), read_timings(folder)
    for label, spent in (timings.get("behaviours") or {}).items():
        detail(f"{folder}: {label} took {spent['seconds']:.1f} s")
    summary = summarise(document["statistics"], assets.find_recipe(chosen))
    if as_json:
        print_json(
            {
                "policy": document["name"],
                "folder": str(folder),
                "trained": trained,
                "fingerprint": document["fingerprint"],
                "compile_seconds": compilation.seconds,
                "seconds": timings,
                "summary": summary,
            }
        )
        return
    say(f"{folder}: {'trained' if trained else 'up to date'}")
    if not talk.quiet:
        _print_summary(summary)


def _check_options(recipe: str | None, name: str | None, behaviours: str | None) -> None:
    """Refuse options that do not go together."""
    if recipe is None and name is None:
        raise CrowdsimError("train: expected a recipe, or --mocap DIR and --name NAME for capture of your own")
    if recipe is not None and name is not None:
        raise CrowdsimError(f"train {recipe} --name {name}: expected a recipe or --name, not both")
    if name is None and behaviours is not None:
        raise CrowdsimError("train --behaviours: expected --name too; a recipe says itself what is learned")


def _write_recipe(name: str, mocap: Path | None, behaviours: str | None) -> Path:
    """Write a recipe for a folder of capture, and note what was left out of it."""
    from crowdsim.scenario.names import NAME_RULE, is_name
    from crowdsim.training.fit_recipe import BEHAVIOURS, check_name, write_recipe
    from crowdsim.training.survey import survey_capture

    check_name(name)
    if not is_name(name):
        raise CrowdsimError(f"--name {name}: expected a name of {NAME_RULE}")
    folder = mocap or os.environ.get("CROWDSIM_MOCAP")
    if not folder:
        raise CrowdsimError(f"train --name {name}: expected a folder of capture by --mocap DIR or in CROWDSIM_MOCAP")
    with Bars() as bars:
        survey = survey_capture(folder, bars)
    path = write_recipe(name, survey, behaviours.split(",") if behaviours else BEHAVIOURS)
    for file in survey.left_out:
        note(f"{survey.folder / file.name}: left out: {file.reason}")
    for file in survey.used:
        if file.change:
            note(f"{survey.folder / file.name}: brought to the skeleton of the others: {file.change}")
    strikes = sum(survey.strikes)
    files = len(survey.used) + len(survey.left_out)
    note(f"{path}: written for {len(survey.used)} of {files} files, {survey.seconds:.1f} s with {strikes} strikes")
    return path


def _print_summary(summary: dict[str, Any]) -> None:
    """Print a summary on one screen."""
    motion, strikes, reach = summary["motion"], summary["strikes"], summary["reach"]
    mirrored = ", and as much again by mirror images" if motion["mirrored"] else ""
    clips = f"{motion['clips']} clip{'s' * (motion['clips'] != 1)}"
    kept = motion["frames_kept"] / max(motion["frames"], 1)
    print(f"  motion      {clips}, {motion['seconds']:.1f} s, {kept:.0%} of it used{mirrored}")
    for clip, change in summary["retargeted"].items():
        print(f"  retargeted  {clip}: {change}")
    print(f"  strikes     {strikes['count']}" + (f", {strikes['used_share']:.0%} used" if strikes["count"] else ""))
    names = {"by_kind": "by kind", "by_hand": "by hand", "by_foot": "by foot", "by_height": "aimed at"}
    for key, words in names.items():
        if key in strikes:
            counts = ", ".join(f"{count} {name}" for name, count in strikes[key].items())
            print(f"    {words:<10}{counts}")
    print(f"  graph       {summary['states']:,} states, {summary['actions']:,} actions")
    if reach is not None:
        (near, far), (low, high) = reach["distance"], reach["height"]
        what = "fists and feet" if "by_foot" in strikes else "fists"
        print(f"  reach       heads {near:.2f} to {far:.2f} m away; {what} {low:.2f} to {high:.2f} m high")
    for row, text in falls_text(summary["falls"]):
        print(f"  {row:<10}  {text}")
    print(f"  speed       follows a target at up to {summary['sustained_speed']:.1f} m/s")
    for name, success in summary["success"].items():
        print(f"  {name:<10}  {_success_text(success)}")
    if summary["duel"] is not None:
        print("  duel        five one-minute duels with itself, mean")
        for row, text in duel_text(summary["duel"]):
            print(f"    {row:<16}{text}")
    weaknesses = summary["weaknesses"]
    print(f"  weaknesses  {len(weaknesses) or 'none found'}")
    for weakness in weaknesses:
        print(f"    {weakness['what']}: {weakness['advice']}")
    print(f"  next        {summary['next']}")
    if not summary["named"]:
        print("    scenarios find policies by name: keep the recipe in the folder policies/ to run it")


def _success_text(success: dict[str, Any]) -> str:
    """Return how often a behaviour succeeds, in words."""
    from crowdsim.training.weaknesses import TASKS

    goal = TASKS[success["task"]]
    text = f"{goal} within {success['seconds']:g} s in {success['share']:.0%} of trials"
    median = success["median_seconds"]
    return text if median is None else f"{text}, after {median:.1f} s in the median"
