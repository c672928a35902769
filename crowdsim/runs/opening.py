"""Runs that were written before."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from crowdsim import assets
from crowdsim.config.documents import document_fault
from crowdsim.core.types import FileName
from crowdsim.errors import CrowdsimError, PolicyError, RecipeError, TakeError
from crowdsim.files import exists_plain
from crowdsim.places.sketch import PlanError
from crowdsim.runs.folder import RESOLVED, place_of, read_resolved
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.recorded import RecordedRun, shown
from crowdsim.scenario.scenario import Scenario
from crowdsim.take.take import Take

POLICIES = "policies"
"""Folder in a run's that policies are packed into."""
_MOST_VALUES = 1 << 21
"""Most values of a resolved scenario, more than one of the longest text becomes."""


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
    run = recorded(folder, replace(take, policies=tuple(policies)))
    notes = [*run.notes]
    if take.status != "done":
        notes.append(f"{folder}: the run was interrupted; {take.frame_count} control frames are there")
    elif not exists_plain(folder, MANIFEST):
        notes.append(f"{folder}: the run is not finished; its take is, some outputs may be missing")
    return replace(run, notes=tuple(notes))


def recorded(folder: Path, take: Take) -> RecordedRun:
    """Return the run of a take in a folder, with what its scenario shows; nothing where that cannot be read."""
    place, found, notes = place_of(folder), dict[str, Any](), tuple[str, ...]()
    try:
        if exists_plain(place, RESOLVED):
            found = shown(_read_scenario(place), place, take.control_rate)
    except (ValueError, PlanError) as error:
        what = "arena, obstacles, cameras and health of the run are not shown"
        notes = (f"{place / RESOLVED}: cannot be read: {error}; {what}",)
    return RecordedRun.of(take, folder=folder, notes=notes, **found)


def _read_scenario(place: Path) -> Scenario:
    """Return the scenario that was run, whose text is longer than what users may write, and may be a stranger's."""
    try:
        data = yaml.load(read_resolved(place), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, RecursionError, LookupError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(str(error).partition("\n")[0]) from None
    level, count = [data], 0
    while level := [one for one in level if isinstance(one, dict | list)]:
        # Values that others stand for count each time.
        count += sum(map(len, level))
        if count > _MOST_VALUES:
            raise ValueError(f"more than {_MOST_VALUES:,} values")
        level = [value for one in level for value in (one.values() if isinstance(one, dict) else one)]
    # Without the folder in its context no file is read.
    fault = document_fault(Scenario, data)
    if fault:
        raise ValueError(fault)
    return Scenario.model_validate(data)


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
