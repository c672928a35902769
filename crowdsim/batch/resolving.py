"""Combinations of a batch as resolved scenarios, each with the identity of its run."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from crowdsim.batch.axes import Combination, combine
from crowdsim.batch.description import Batch
from crowdsim.batch.documents import read_bytes
from crowdsim.config.files import Finding
from crowdsim.errors import BatchError, CrowdsimError, ScenarioError
from crowdsim.scenario.outputs import Outputs
from crowdsim.scenario.scenario import Scenario, dump_scenario, load_scenario

MAXIMUM_FINDINGS = 20
"""After so many findings no more are looked for."""

_GIVEN = re.compile(r"--set (?P<key>[^=]+)=.*", re.DOTALL)


@dataclass(frozen=True)
class Resolved:
    """A run that is planned.

    Attributes:
        id: What it is known by: a hash of its resolved scenario.
        scenario: The scenario, resolved, without the outputs that are written once its take is finished.
        text: The same as YAML.
        outputs: These outputs, resolved.
    """

    id: str
    scenario: Scenario
    text: str
    outputs: Outputs


def resolve(
    batch: Batch, progress: Callable[[str, int, int], None] | None = None
) -> tuple[dict[str, Resolved], list[tuple[Combination, str]]]:
    """Return the runs of a batch by their ids, and all combinations with the id of the run that each one is.

    Raises:
        BatchError: A key is missing or a value does not fit, with every finding in a line of its own.
        ScenarioError: A scenario is missing or invalid in itself.
    """
    runs: dict[str, Resolved] = {}
    found: list[tuple[Combination, str]] = []
    findings: dict[str, Finding] = {}
    seen: set[str] = set()
    base = {name: _find(batch, i) for i, name in enumerate(batch.scenarios)}
    combinations = list(combine(batch.scenarios, batch.all_axes, batch.exclude))
    if not combinations:
        raise BatchError(str(batch.place(Finding(("exclude",), "leaves out all runs, expected some that stay"))))
    outputs = [] if batch.outputs is None else [f"outputs={_text(batch.outputs.model_dump(exclude_unset=True))}"]
    for number, one in enumerate(combinations):
        given = [*outputs, *batch.set, *(f"{key}={_text(value)}" for key, value in one.values.items())]
        try:
            resolved = split(load_scenario(base[one.scenario], given))
            if resolved.id not in runs:
                _check(resolved.scenario, seen)
        except CrowdsimError as error:
            for finding in _blame(batch, one, error):
                findings.setdefault(str(finding), finding)
            if len(findings) >= MAXIMUM_FINDINGS:
                break
            continue
        runs.setdefault(resolved.id, resolved)
        found.append((one, resolved.id))
        if progress is not None:
            progress("plan", number + 1, len(combinations))
    if findings:
        placed = sorted(findings.values(), key=lambda finding: (finding.line or 10**9, finding.column))
        failure = BatchError("\n".join(map(str, placed)))
        failure.findings = tuple(placed)  # type: ignore[attr-defined]
        raise failure
    return runs, found


def split(scenario: Scenario) -> Resolved:
    """Return a resolved scenario as a planned run: its outputs apart, but for those that are written beside the take.

    The run's id does not depend on the outputs that are apart, so that others do not repeat the simulation.
    """
    outputs = scenario.outputs
    alone = scenario.model_copy(update={"outputs": outputs.only(from_take=False)})
    text = dump_scenario(alone)
    return Resolved(hashlib.sha256(text.encode()).hexdigest()[:16], alone, text, outputs)


def _check(scenario: Scenario, seen: set[str]) -> None:
    """Check a scenario against its policies, and that its avatars fit, unless one that differs only in its seed was.

    Raises:
        CrowdsimError: It does not pass.
    """
    from crowdsim.crowd.placement import place_groups
    from crowdsim.preparation.prepare import LARGE
    from crowdsim.preparation.validation import check_scenario

    alike = scenario.model_copy(update={"seed": 0}).model_dump_json()
    if alike not in seen:
        seen.add(alike)
        check_scenario(scenario)
    if scenario.avatar_count < LARGE:
        place_groups(scenario)


def _find(batch: Batch, index: int) -> Path:
    """Return the file of a scenario, which is valid with the values that are set for all."""
    try:
        path = batch.find_scenario(batch.scenarios[index])
    except ScenarioError as error:
        raise BatchError(str(batch.place(Finding(("scenarios", index), str(error))))) from None
    load_scenario(path, batch.set)
    return path


def _text(value: Any) -> str:
    """Return plain data as YAML in one line."""
    return json.dumps(value, ensure_ascii=False)


def _blame(batch: Batch, one: Combination, error: CrowdsimError) -> Iterable[Finding]:
    """Yield the findings of a combination at the values of the batch that are to blame.

    What comes of several values together is reported of the combination.
    """
    keys = _positions(batch, one.indices)
    for finding in getattr(error, "findings", ()):
        given = _GIVEN.fullmatch(finding.source)
        if given is not None and given["key"] in keys:
            at, said = keys[given["key"]], f"{finding.key}: {finding.message}" if finding.key else finding.message
            of_key = None if finding.of_key is None else at[:3]
            yield batch.place(Finding(at if of_key is None else of_key, f"for {one.scenario}: {said}", of_key))
        elif given is not None and given["key"] == "outputs":
            yield batch.place(Finding(finding.loc, f"for {one.scenario}: {finding.message}"))
        else:
            plain = replace(finding, source="", line=0, column=0)
            yield batch.place(Finding(("axes",), f"{one}: {plain}"))
    if not hasattr(error, "findings"):
        yield batch.place(Finding(("axes",), f"{one}: {error}"))


def _positions(batch: Batch, indices: tuple[int, ...]) -> Mapping[str, tuple[Any, ...]]:
    """Return where the values of a combination are in the batch, by key."""
    found: dict[str, tuple[Any, ...]] = {}
    for i, (axis, index) in enumerate(zip(batch.axes, indices, strict=True)):
        for key, values in axis.items():
            found[key] = ("axes", i, key, index) if isinstance(values, list) else ("axes", i, key)
    return found


def write_frozen(folder: Path, resolved: Resolved) -> Path:
    """Write a resolved scenario, with the files that it reads beside it, into a folder of its own; return its path.

    Raises:
        BatchError: Something else than a file is in its place.
        OutputError: It cannot be written.
    """
    from crowdsim.files import copy_plain, make_folder, write_text
    from crowdsim.runs.folder import RESOLVED

    place = folder / resolved.id
    path = place / RESOLVED
    if read_bytes(place, RESOLVED) == resolved.text.encode("utf-8"):
        return path
    make_folder(place)
    for name in resolved.scenario.files:
        copy_plain(resolved.scenario.folder / name, place, name)
    write_text(path, resolved.text)
    return path
