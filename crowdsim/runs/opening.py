"""Runs that were written before."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from crowdsim import assets
from crowdsim.core.types import Array, FileName
from crowdsim.errors import CrowdsimError, PolicyError, RecipeError, TakeError
from crowdsim.files import exists_plain
from crowdsim.runs.folder import place_of, resolved_value
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.recorded import RecordedRun
from crowdsim.scenario.cameras import Cameras
from crowdsim.scenario.heals import Heal, find_heals
from crowdsim.scenario.output import FPS
from crowdsim.scenario.parts import Arena
from crowdsim.take.take import Take

POLICIES = "policies"
"""Folder in a run's that policies are packed into."""


def open_run(folder: FileName) -> RecordedRun:
    """Return a run that was written before: its take with its policies, and what a user should know of it.

    Raises:
        TakeError: There is no take, or it is damaged.
        PolicyError: A policy is missing, or not the one it was recorded with.
        OutputError: Exports that were committed cannot be put in their places.
    """
    from crowdsim.policy.bundle import load_policy
    from crowdsim.take.store import open_take

    folder = Path(folder)
    take = open_take(folder)
    policies = [load_policy(bundle_of(folder, name)) for name in take.cast.policy_names]
    notes = []
    if take.status != "done":
        notes.append(f"{folder}: the run was interrupted; {take.frame_count} control frames are there")
    elif not exists_plain(folder, MANIFEST):
        notes.append(f"{folder}: the run is not finished; its take is, some outputs may be missing")
    return replace(recorded(folder, take), policies=tuple(policies), notes=tuple(notes))


def recorded(folder: Path, take: Take) -> RecordedRun:
    """Return the run of a take in a folder, with what is known of its scenario, as far as that can be read."""
    return RecordedRun.of(
        take,
        folder=folder,
        arena=read_arena(folder),
        obstacles=read_obstacles(folder),
        fps=_read(folder, "fps", float, FPS),
        cameras=_read(folder, "cameras", Cameras, {}),
        health=_read_health(folder),
        heals=_read_heals(folder, take.control_rate),
    )


def bundle_of(folder: Path, policy: str, fingerprint: str | None = None) -> Path:
    """Return the folder of a policy that a run was made with, from any working folder.

    It is that in the run's own folder, else the first one with the fingerprint: where the run was made, found by its
    name, in ``policies`` of a folder above the run's, or any among those that are found by name.

    Args:
        folder: The run folder.
        policy: Name of the policy.
        fingerprint: The one that it must have; where None, that of the run's manifest, and any where it has none.

    Raises:
        PolicyError: It is missing, or has another fingerprint.
    """
    from crowdsim.training.train import find_bundle

    recorded: dict[str, Any] = {}
    with suppress(TakeError):
        recorded = read_manifest(folder)
    fingerprint = fingerprint or recorded.get("policies", {}).get(policy)
    places = [folder / POLICIES / policy]
    if not exists_plain(folder, f"{POLICIES}/{policy}/policy.json"):
        places = [Path(place) for name, place in recorded.get("policy_folders", {}).items() if name == policy]
        with suppress(PolicyError, RecipeError):
            places.append(find_bundle(policy))
        places += [above / POLICIES / policy for above in folder.absolute().parents[:2]]
        for known in assets.folders("policies") if fingerprint else ():
            places += [document.parent for document in sorted(known.glob("*/policy.json"))]
    found = {place: _fingerprint(place) for place in places}
    for place, now in found.items():
        if now is not None and fingerprint in (None, now):
            return place
    tried = ", ".join(map(str, found)) or "nothing was found by its name"
    is_there = any(now is not None and place.name == policy for place, now in found.items())
    what = "is not the one that the take was recorded with" if is_there else "is missing"
    remedy = "train it as it was, or run the scenario again"
    raise PolicyError(f"{folder}: policy {policy!r} {what} (looked in {tried}); {remedy}")


def _fingerprint(bundle: Path) -> str | None:
    """Return the fingerprint of a bundle; None where there is none that can be read."""
    from crowdsim.policy.bundle import read_document

    try:
        return str(read_document(bundle)["fingerprint"])
    except CrowdsimError:
        return None


def read_arena(folder: Path) -> Array:
    """Return the arena of the scenario that was run in a folder, see ``pack_arena``. Shape (5,).

    Ground is open where the scenario is not there any more or says nothing that can be read.
    """
    from crowdsim.crowd.draw import pack_arena

    arena: Any = _read(folder, "arena", Arena, None)
    return np.zeros(5) if arena is None else pack_arena(arena)


def read_obstacles(folder: Path) -> Array:
    """Return the obstacles of the scenario that was run in a folder, see ``TakeSource``. Shape (n,), ``PART``.

    There are none where the scenario, or a floor plan, is not there any more or says nothing that can be read.
    """
    from crowdsim.crowd.obstacles import obstacle_shapes
    from crowdsim.places.arrays import pack_parts
    from crowdsim.places.description import Obstacles
    from crowdsim.places.sketch import PlanError
    from crowdsim.scenario.parts import NoArena

    arena: Any = _read(folder, "arena", Arena, NoArena(kind="none"))
    obstacles: Any = _read(folder, "obstacles", Obstacles, ())
    try:
        return pack_parts(obstacle_shapes(obstacles, arena, place_of(folder)), None)
    except PlanError:
        return pack_parts((), None)


def _read_health(folder: Path) -> dict[str, float]:
    """Return the health at the start of avatars that can be hurt, by the names of their types [points]."""
    types: dict[str, dict[str, Any]] = _read(folder, "types", dict[str, dict[str, Any]], {})
    found = {name: keys["damage"].get("health") for name, keys in types.items() if isinstance(keys.get("damage"), dict)}
    # What no scenario may say, such as a number without end, says nothing.
    return {
        name: float(points) for name, points in found.items() if isinstance(points, int | float) and 0 < points <= 1e6
    }


def _read_heals(folder: Path, rate: float) -> list[Heal]:
    """Return when health is restored in a run; never where its scenario says nothing that can be read."""
    groups, events = (_read(folder, key, tuple[dict[str, Any], ...], ()) for key in ("groups", "events"))
    try:
        return find_heals(groups, events, rate)
    except (KeyError, TypeError, ValueError, OverflowError):  # a file that was changed by hand
        return []


def _read(folder: Path, key: str, kind: Any, otherwise: Any) -> Any:
    """Return what the scenario that was run in a folder says at a key; ``otherwise`` where it says nothing readable."""
    try:
        return TypeAdapter(kind).validate_python(resolved_value(place_of(folder), key))
    except ValueError:
        return otherwise
