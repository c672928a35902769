"""The plan of a batch: its combinations resolved to runs, what they take, and the file that keeps all of it."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from crowdsim.batch.description import Batch, Combination
from crowdsim.batch.documents import MAXIMUM_BYTES, read_bytes, read_document
from crowdsim.config.documents import DocumentModel
from crowdsim.config.files import Finding, validate
from crowdsim.config.tree import Document
from crowdsim.core.types import Progress
from crowdsim.errors import BatchError, CrowdsimError, ScenarioError
from crowdsim.files import copy_plain, make_folder, write_plain, write_text
from crowdsim.places.mesh import area_of
from crowdsim.preparation.prepare import LARGE, estimate_needs, policy_names
from crowdsim.runs.folder import RESOLVED
from crowdsim.runs.manifest import checksum, signed_text
from crowdsim.scenario.output import Extent
from crowdsim.scenario.outputs import Outputs
from crowdsim.scenario.parts import MAXIMUM_FRAMES, Name
from crowdsim.scenario.scenario import Scenario, dump_scenario, load_scenario

NAME = "batch.json"
RUNS, SCENARIOS, POLICIES, WORK, LOGS, RESULTS, REPORT = FOLDERS = (
    "runs", "scenarios", "policies", "work", "logs", "results", "report"
)  # fmt: skip
"""Folders in a batch's."""
_MOST_FINDINGS = 20
"""After so many findings no more are looked for."""

# Bytes that a run takes beside its take and outputs, and seconds that one core takes for a run beside its frames, and
# for a control frame of an avatar. Measured with the shipped scenarios, rounded up.
_RUN_BYTES, _RUN_SECONDS, _CONTROL_SECONDS = 100e3, 0.2, 2e-6
_GIVEN = re.compile(r"--set (?P<key>[^=]+)=.*", re.DOTALL)
_ALIKE = ("scenario", "avatars", "control_frames", "control_rate")
_Amount = Annotated[float, Field(ge=0, le=1e30)]
_Id = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]


class Estimate(DocumentModel):
    """What a run takes: room on disk with its outputs [bytes], memory of the process [bytes], time on one core [s]."""

    bytes: _Amount
    memory: _Amount
    seconds: _Amount


class _Alike(DocumentModel):
    """Runs that differ in their seeds alone, or in what a plan does not say."""

    scenario: Name
    avatars: Annotated[int, Field(ge=1, le=10**9)]
    control_frames: Annotated[int, Field(ge=1, le=MAXIMUM_FRAMES)]
    control_rate: Annotated[float, Field(gt=0, le=1e6)]
    policies: list[Name]
    outputs: dict[str, Any]
    estimate: Estimate
    seeds: dict[_Id, Annotated[int, Field(ge=0, lt=2**63)]]


class _Environment(DocumentModel):
    """What runs are made with."""

    versions: dict[str, str]
    processor: str


class _Plan(DocumentModel):
    """A plan as it is written."""

    format: Literal["crowdsim-batch"]
    version: Literal[2]
    batch: dict[str, Any]
    policies: dict[Name, str]
    environment: _Environment
    combinations: list[_Id]
    runs: list[_Alike]
    checksum: str


@dataclass(frozen=True)
class Resolved:
    """A run whose scenario is resolved.

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


@dataclass(frozen=True)
class PlannedRun:
    """A run as the plan keeps it: plain data of the size of its take, outputs that follow, and what it takes."""

    id: str
    scenario: str
    seed: int
    avatars: int
    control_frames: int
    control_rate: float
    outputs: Outputs
    policies: tuple[str, ...]
    estimate: Estimate

    @property
    def folder(self) -> str:
        """Name of the run folder in the batch's."""
        return f"{RUNS}/{self.scenario}-{self.id}"

    @property
    def mark(self) -> str:
        """A checksum of its outputs, which tells whether others have been written."""
        return checksum({"outputs": self.outputs.only(from_take=True).model_dump(mode="json", exclude_none=True)})


@dataclass(frozen=True)
class Plan:
    """All runs of a batch.

    Attributes:
        batch: The batch.
        combinations: All its combinations, each with the id of its run.
        runs: The runs by id.
        policies: Fingerprints of policies, by name.
        environment: What the runs are made with (``crowdsim.batch.workers.describe_environment``).
    """

    batch: Batch
    combinations: tuple[tuple[Combination, str], ...]
    runs: Mapping[str, PlannedRun]
    policies: Mapping[str, str] = field(default_factory=dict)
    environment: Mapping[str, Any] = field(default_factory=dict)


def resolve(
    batch: Batch, progress: Progress | None = None
) -> tuple[dict[str, Resolved], list[tuple[Combination, str]]]:
    """Return the runs of a batch by their ids, and all combinations with the id of the run that each one is.

    The id of a run does not depend on outputs that are written once its take is finished: others repeat no simulation.

    Raises:
        BatchError: A key is missing or a value does not fit, with every finding in a line of its own.
        ScenarioError: A scenario is missing or invalid in itself.
    """
    runs: dict[str, Resolved] = {}
    found: list[tuple[Combination, str]] = []
    findings: dict[str, Finding] = {}
    seen: set[str] = set()
    base = {name: _find(batch, i) for i, name in enumerate(batch.scenarios)}
    combinations = list(batch.combinations())
    if not combinations:
        raise BatchError(str(batch.place(Finding(("exclude",), "leaves out all runs, expected some that stay"))))
    outputs = [] if batch.outputs is None else _given({"outputs": batch.outputs.model_dump(exclude_unset=True)})
    for number, one in enumerate(combinations):
        try:
            scenario = load_scenario(base[one.scenario], [*outputs, *batch.set, *_given(one.values)])
            alone = scenario.model_copy(update={"outputs": scenario.outputs.only(from_take=False)})
            text = dump_scenario(alone)
            id = hashlib.sha256(text.encode()).hexdigest()[:16]
            if id not in runs:
                _check(alone, seen)
        except CrowdsimError as error:
            findings.update((str(finding), finding) for finding in _blame(batch, one, error))
            if len(findings) >= _MOST_FINDINGS:
                break
            continue
        runs.setdefault(id, Resolved(id, alone, text, scenario.outputs))
        found.append((one, id))
        if progress is not None:
            progress("plan", number + 1, len(combinations))
    if findings:
        placed = sorted(findings.values(), key=lambda finding: (finding.line or 10**9, finding.column))
        failure = BatchError("\n".join(map(str, placed)))
        failure.findings = tuple(placed)  # type: ignore[attr-defined]
        raise failure
    return runs, found


def _given(values: Mapping[str, Any]) -> list[str]:
    return [f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in values.items()]


def _find(batch: Batch, index: int) -> Path:
    """Return the file of a scenario, which is valid with the values that are set for all."""
    try:
        path = batch.find_scenario(batch.scenarios[index])
    except ScenarioError as error:
        raise BatchError(str(batch.place(Finding(("scenarios", index), str(error))))) from None
    load_scenario(path, batch.set)
    return path


def _check(scenario: Scenario, seen: set[str]) -> None:
    """Check that avatars fit, and a scenario against its policies, unless one that differs only in its seed was."""
    from crowdsim.crowd.placement import place_groups
    from crowdsim.preparation.validation import check_scenario

    alike = scenario.model_copy(update={"seed": 0}).model_dump_json()
    if alike not in seen:
        seen.add(alike)
        check_scenario(scenario)
    if scenario.avatar_count < LARGE:
        place_groups(scenario)


def _blame(batch: Batch, one: Combination, error: CrowdsimError) -> Iterator[Finding]:
    """Yield the findings of a combination at the values of the batch that are to blame.

    What comes of several values together is reported of the combination.
    """
    keys: dict[str, tuple[Any, ...]] = {}
    for i, (axis, index) in enumerate(zip(batch.axes, one.indices, strict=True)):
        keys.update((key, ("axes", i, key, *[index][: isinstance(at, list)])) for key, at in axis.items())
    for finding in getattr(error, "findings", ()):
        given = _GIVEN.fullmatch(finding.source)
        if given is not None and given["key"] in keys:
            at, said = keys[given["key"]], f"{finding.key}: {finding.message}" if finding.key else finding.message
            of_key = None if finding.of_key is None else at[:3]
            yield batch.place(Finding(of_key or at, f"for {one.scenario}: {said}", of_key))
        elif given is not None and given["key"] == "outputs":
            yield batch.place(Finding(finding.loc, f"for {one.scenario}: {finding.message}"))
        else:
            yield batch.place(Finding(("axes",), f"{one}: {replace(finding, source='', line=0, column=0)}"))
    if not hasattr(error, "findings"):
        yield batch.place(Finding(("axes",), f"{one}: {error}"))


def make_plan(batch: Batch, runs: Mapping[str, Resolved], combinations: Iterable[tuple[Combination, str]]) -> Plan:
    """Return the plan of a batch whose runs are resolved."""
    from crowdsim.crowd.obstacles import pack_obstacles
    from crowdsim.preparation.validation import control_rate

    rates: dict[tuple[str, ...], float] = {}
    planned = {}
    for id, one in runs.items():
        scenario, policies = one.scenario, tuple(policy_names(one.scenario))
        if policies not in rates:
            rates[policies] = control_rate(scenario)
        area = area_of(pack_obstacles(scenario, None))
        size = Extent(scenario.avatar_count, scenario.control_frames(rates[policies]), rates[policies], area)
        needed = estimate(size, one.outputs)
        planned[id] = PlannedRun(id, scenario.name, scenario.seed, *size[:3], one.outputs, policies, needed)
    return Plan(batch, tuple(combinations), planned)


def estimate(size: Extent, outputs: Outputs) -> Estimate:
    """Return what a run takes, from measured costs."""
    memory, room = estimate_needs(size.avatars, size.control_frames)
    room += _RUN_BYTES
    seconds = _RUN_SECONDS + _CONTROL_SECONDS * size.avatars * size.control_frames
    for output in outputs.wanted():
        more, time = output.cost(size)
        room, seconds = room + more, seconds + time
    return Estimate(bytes=room, memory=memory, seconds=seconds)


def check_disk(folder: Path, estimates: Iterable[Estimate]) -> None:
    """Raise a ``BatchError`` if the disk has no room for runs."""
    needed = sum(one.bytes for one in estimates)
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(existing).free
    if needed > free:
        what = f"the runs take about {needed / 1e9:.1f} GB, and {free / 1e9:.1f} GB are free in {existing}"
        raise BatchError(f"{folder}: {what}; expected fewer runs or outputs, or --out on another disk")


def write_frozen(folder: Path, resolved: Resolved) -> Path:
    """Write a resolved scenario, with the files that it reads beside it, into a folder of its own; return its path."""
    place = folder / resolved.id
    if read_bytes(place, RESOLVED) != resolved.text.encode("utf-8"):
        make_folder(place)
        for name in resolved.scenario.files:
            copy_plain(resolved.scenario.folder / name, place, name)
        write_text(place / RESOLVED, resolved.text)
    return place / RESOLVED


def write_plan(folder: Path, plan: Plan) -> None:
    """Write a plan into the folder of its batch."""
    alike: dict[str, dict[str, Any]] = {}
    for run in plan.runs.values():
        facts = {key: getattr(run, key) for key in _ALIKE}
        facts["policies"], facts["estimate"] = list(run.policies), run.estimate.model_dump()
        facts["outputs"] = run.outputs.model_dump(mode="json", exclude_none=True)
        alike.setdefault(json.dumps(facts), {**facts, "seeds": {}})["seeds"][run.id] = run.seed
    document = {
        "format": "crowdsim-batch",
        "version": 2,
        "batch": plan.batch.model_dump(mode="json", exclude_unset=True),
        "policies": dict(plan.policies),
        "environment": dict(plan.environment),
        "combinations": [id for _, id in plan.combinations],
        "runs": list(alike.values()),
    }
    text = signed_text(document)
    if len(text) > MAXIMUM_BYTES:
        raise BatchError(f"{folder / NAME}: would be too long, expected fewer runs or shorter values of axes")
    write_plain(folder, NAME, text, lasts=True)


def is_batch(folder: Path) -> bool:
    """Whether a folder is that of a batch."""
    return (folder / NAME).is_file()


def read_plan(folder: Path) -> Plan:
    """Return the plan in the folder of a batch.

    Raises:
        BatchError: There is none, or it is damaged.
    """
    document = read_document(folder, NAME, _Plan)
    if not document:
        raise BatchError(f"{folder}: no {NAME} here, or an empty one, so this is no batch")
    damaged = f"{folder / NAME}: is damaged"
    if document["checksum"] != checksum(document):
        raise BatchError(f"{damaged}: its checksum does not fit what it says")
    batch = validate(Document(damaged, document["batch"]), Batch, BatchError)
    for key in batch.swept:
        if re.split(r"[.\[]", key)[0] not in Scenario.model_fields:
            raise BatchError(f"{damaged}: batch.axes: {key!r} is no key of scenarios")
    ids, combinations = document["combinations"], list(batch.combinations())
    try:
        planned = {run.id: run for alike in document["runs"] for run in _read_runs(alike)}
    except ValidationError as error:
        raise BatchError(f"{damaged}: runs: outputs: {error.errors()[0]['msg']}") from None
    if not ids or len(ids) != len(combinations) or set(ids) != planned.keys():
        raise BatchError(f"{damaged}: combinations: are not those of its batch and runs")
    pairs, runs = tuple(zip(combinations, ids, strict=True)), {id: planned[id] for id in dict.fromkeys(ids)}
    return Plan(batch, pairs, runs, document["policies"], document["environment"])


def _read_runs(alike: Mapping[str, Any]) -> Iterator[PlannedRun]:
    facts = {key: alike[key] for key in _ALIKE}
    facts["outputs"] = Outputs.model_validate_json(json.dumps(alike["outputs"]))
    facts["policies"], facts["estimate"] = tuple(alike["policies"]), Estimate(**alike["estimate"])
    for id, seed in alike["seeds"].items():
        yield PlannedRun(id=id, seed=seed, **facts)
