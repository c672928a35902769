"""What training ends with: a summary of a policy from the statistics of its bundle, as plain data."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from crowdsim import assets
from crowdsim.errors import RecipeError
from crowdsim.training.weaknesses import find_weaknesses


def summarise(statistics: Mapping[str, Any], recipe: Path) -> dict[str, Any]:
    """Return a summary of a policy as plain data.

    Returns:
        ``motion``: clips, seconds, mirrored, control frames, those that the graph keeps. ``retargeted``: what was
        changed of clips of other skeletons, by name. ``strikes``: how many, by hand, foot, kind and
        height, mirror images left out, and the share that the graph keeps. ``states`` and ``actions`` of the graph.
        ``reach``: distances from which strikes reach a head, and heights of fists and feet
        [m]; None without strikes. ``falls``: directions of falls and staggers [rad]; None without falls.
        ``sustained_speed`` [m/s]. ``success`` of each behaviour. ``duel``: what comes of duels with itself
        (``self_play.grading.Duels``); None where none were fought. ``weaknesses``: what, and what to do about it.
        ``named``: whether scenarios find the policy. ``next``: a command to type.
    """
    motion, graph, strikes = statistics["motion"], statistics["graph"], statistics.get("strikes")
    keys = ("by_hand", "by_foot", "by_kind", "by_height", "used_share")
    counts = {key: strikes[key] for key in keys if key in strikes} if strikes else {}
    reach = {"distance": strikes["striking_range"], "height": list(strikes["reach"]["height"])} if strikes else None
    return {
        "motion": {key: motion[key] for key in ("clips", "seconds", "mirrored", "frames", "frames_kept")},
        "retargeted": statistics.get("retargeted", {}),
        "strikes": {"count": motion["strikes"], **counts},
        "states": graph["states"],
        "actions": graph["actions"],
        "reach": reach,
        "falls": statistics.get("falls"),
        "sustained_speed": statistics["sustained_speed"],
        "success": {name: facts["success"] for name, facts in statistics["behaviours"].items()},
        "duel": statistics.get("duel"),
        "weaknesses": [asdict(weakness) for weakness in find_weaknesses(statistics)],
        "named": is_named(recipe),
        "next": next_command(recipe),
    }


def is_named(recipe: Path) -> bool:
    """Return whether scenarios find a policy by its name from the working folder, as they must."""
    try:
        return assets.find_recipe(recipe.stem).resolve() == recipe.resolve()
    except RecipeError:
        return False


def next_command(recipe: Path) -> str:
    """Return a command that shows a policy: in a scenario, or by its figures where no scenario can find it."""
    if not is_named(recipe):
        return shlex.join(["crowdsim", "inspect", str(recipe)])
    name = recipe.stem
    return shlex.join(
        ["crowdsim", "run", "duel", "--set", f"types.boxer.policy={name}", "--out", f"output/duel_{name}"]
    )
