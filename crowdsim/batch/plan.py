"""The plan of a batch: which runs there are, frozen in its folder before the first one begins."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from crowdsim.batch.axes import Combination, combine
from crowdsim.batch.description import Batch
from crowdsim.batch.documents import MAXIMUM_BYTES, read_document
from crowdsim.batch.estimates import Estimate, estimate
from crowdsim.batch.resolving import Resolved
from crowdsim.config.documents import DocumentModel
from crowdsim.config.files import validate
from crowdsim.config.tree import Document
from crowdsim.errors import BatchError
from crowdsim.files import write_plain
from crowdsim.runs.manifest import checksum, signed_text
from crowdsim.scenario.outputs import Outputs
from crowdsim.scenario.parts import MAXIMUM_FRAMES, Name
from crowdsim.scenario.scenario import Scenario

NAME = "batch.json"
FORMAT = "crowdsim-batch"
VERSION = 2
RUNS, SCENARIOS, POLICIES, WORK, LOGS, RESULTS, REPORT = (
    "runs", "scenarios", "policies", "work", "logs", "results", "report"
)  # fmt: skip
"""Folders in a batch's."""
OWN = (".crowdsim-", f".{NAME}")
"""How names begin of what a process leaves in such a folder that was killed before it wrote the plan."""

_Amount = Annotated[float, Field(ge=0, le=1e30)]
_Id = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]


class _Needs(DocumentModel):
    """What a run takes."""

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
    estimate: _Needs
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
class PlannedRun:
    """A run of a batch.

    Attributes:
        id: What it is known by, a hash of its resolved scenario.
        scenario: Name of the scenario.
        seed: Its seed.
        avatars: Number of avatars.
        control_frames: Control frames.
        control_rate: Control frames a second.
        outputs: What is written once its take is finished.
        policies: Names of its policies.
        estimate: What it takes.
    """

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
        environment: What the runs are made with (``crowdsim.batch.engine.describe_environment``).
    """

    batch: Batch
    combinations: tuple[tuple[Combination, str], ...]
    runs: Mapping[str, PlannedRun]
    policies: Mapping[str, str] = field(default_factory=dict)
    environment: Mapping[str, Any] = field(default_factory=dict)

    @property
    def axes(self) -> list[dict[str, Sequence[Any]]]:
        """Keys and their values, of each axis."""
        return [dict(zip(axis.keys, axis.columns, strict=True)) for axis in self.batch.all_axes]


def make_plan(batch: Batch, runs: Mapping[str, Resolved], combinations: Iterable[tuple[Combination, str]]) -> Plan:
    """Return the plan of a batch whose runs are resolved.

    Args:
        batch: The batch.
        runs: Its runs by id.
        combinations: Its combinations with the ids of their runs.

    Raises:
        RecipeError: The recipe of a policy is invalid.
        PolicyError: A bundle is damaged.
    """
    rates: dict[tuple[str, ...], float] = {}
    return Plan(batch, tuple(combinations), {id: _plan_run(resolved, rates) for id, resolved in runs.items()})


def _plan_run(resolved: Resolved, rates: dict[tuple[str, ...], float]) -> PlannedRun:
    """Return a resolved run with what follows from it; ``rates`` keeps the control rate by policies."""
    from crowdsim.preparation.prepare import policy_names
    from crowdsim.preparation.validation import control_rate

    scenario, policies = resolved.scenario, tuple(policy_names(resolved.scenario))
    if policies not in rates:
        rates[policies] = control_rate(scenario)
    rate = rates[policies]
    frames = scenario.control_frames(rate)
    needed = estimate(scenario.avatar_count, frames, rate, resolved.outputs)
    size = scenario.avatar_count, frames, rate
    return PlannedRun(resolved.id, scenario.name, scenario.seed, *size, resolved.outputs, policies, needed)


def write_plan(folder: Path, plan: Plan) -> None:
    """Write a plan into the folder of its batch.

    Raises:
        BatchError: It is too long to be read again.
        OutputError: It cannot be written.
    """
    alike: dict[str, dict[str, Any]] = {}
    for run in plan.runs.values():
        facts = {key: getattr(run, key) for key in ("scenario", "avatars", "control_frames", "control_rate")}
        facts["policies"], facts["estimate"] = list(run.policies), asdict(run.estimate)
        facts["outputs"] = run.outputs.model_dump(mode="json", exclude_none=True)
        alike.setdefault(json.dumps(facts), {**facts, "seeds": {}})["seeds"][run.id] = run.seed
    document = {
        "format": FORMAT,
        "version": VERSION,
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
    for key in (key for axis in batch.axes for key in axis):
        if re.split(r"[.\[]", key)[0] not in Scenario.model_fields:
            raise BatchError(f"{damaged}: batch.axes: {key!r} is no key of scenarios")
    ids = document["combinations"]
    combinations = list(combine(batch.scenarios, batch.all_axes, batch.exclude))
    try:
        planned = {run.id: run for alike in document["runs"] for run in _read_runs(alike)}
    except ValidationError as error:
        raise BatchError(f"{damaged}: runs: outputs: {error.errors()[0]['msg']}") from None
    if not ids or len(ids) != len(combinations) or set(ids) != planned.keys():
        raise BatchError(f"{damaged}: combinations: are not those of its batch and runs")
    pairs = tuple(zip(combinations, ids, strict=True))
    runs = {id: planned[id] for id in dict.fromkeys(ids)}
    return Plan(batch, pairs, runs, document["policies"], document["environment"])


def _read_runs(alike: Mapping[str, Any]) -> Iterable[PlannedRun]:
    """Yield the runs that are alike."""
    facts = {key: alike[key] for key in ("scenario", "avatars", "control_frames", "control_rate")}
    outputs, needs = Outputs.model_validate_json(json.dumps(alike["outputs"])), Estimate(**alike["estimate"])
    for id, seed in alike["seeds"].items():
        yield PlannedRun(id=id, seed=seed, policies=tuple(alike["policies"]), outputs=outputs, estimate=needs, **facts)
