"""The plan of a batch: which runs there are, frozen in its folder before the first one begins."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from crowdsim.batch.axes import Combination
from crowdsim.batch.description import Batch
from crowdsim.batch.estimates import Estimate, estimate
from crowdsim.batch.resolving import Resolved
from crowdsim.errors import BatchError
from crowdsim.files import open_plain, write_plain
from crowdsim.runs.manifest import checksum, signed_text
from crowdsim.scenario.outputs import Outputs

NAME = "batch.json"
FORMAT = "crowdsim-batch"
VERSION = 1
RUNS, SCENARIOS, POLICIES, WORK, LOGS, RESULTS, REPORT = (
    "runs", "scenarios", "policies", "work", "logs", "results", "report"
)  # fmt: skip
"""Folders in a batch's."""
OWN = (".crowdsim-", f".{NAME}")
"""How names begin of what a process leaves in such a folder that was killed before it wrote the plan."""


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
        return checksum({"outputs": self.outputs.model_dump(mode="json", exclude={"take", "profile"})})


@dataclass(frozen=True)
class Plan:
    """All runs of a batch.

    Attributes:
        name: Name of the batch.
        description: What it is for.
        scenarios: Scenarios as the batch names them.
        axes: Keys and their values, of each axis.
        combinations: All combinations, each with the id of its run.
        runs: The runs by id.
        frames_per_task: Pictures that one task draws.
        policies: Fingerprints of policies, by name.
        environment: What the runs are made with (``crowdsim.batch.environment``).
    """

    name: str
    description: str
    scenarios: tuple[str, ...]
    axes: tuple[Mapping[str, Sequence[Any]], ...]
    combinations: tuple[tuple[Combination, str], ...]
    runs: Mapping[str, PlannedRun]
    frames_per_task: int
    policies: Mapping[str, str] = field(default_factory=dict)
    environment: Mapping[str, Any] = field(default_factory=dict)


def make_plan(
    batch: Batch,
    runs: Mapping[str, Resolved],
    combinations: Iterable[tuple[Combination, str]],
) -> Plan:
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
    planned = {id: _plan_run(resolved, rates) for id, resolved in runs.items()}
    axes = tuple(
        {key: list(column) for key, column in zip(axis.keys, axis.columns, strict=True)} for axis in batch.all_axes
    )
    return Plan(
        batch.name, batch.description, batch.scenarios, axes, tuple(combinations), planned, batch.frames_per_task
    )


def _plan_run(resolved: Resolved, rates: dict[tuple[str, ...], float]) -> PlannedRun:
    """Return a resolved run with what follows from it; ``rates`` keeps the control rate by policies."""
    from crowdsim.runs.preparation import policy_names
    from crowdsim.runs.validation import control_rate

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
        OutputError: It cannot be written.
    """
    document = {
        "format": FORMAT,
        "version": VERSION,
        **{key: getattr(plan, key) for key in ("name", "description", "frames_per_task")},
        "scenarios": list(plan.scenarios),
        "axes": [dict(axis) for axis in plan.axes],
        "policies": dict(plan.policies),
        "environment": dict(plan.environment),
        "combinations": [
            {"scenario": one.scenario, "indices": list(one.indices), "values": dict(one.values), "run": id}
            for one, id in plan.combinations
        ],
        "runs": [_describe(run) for run in plan.runs.values()],
    }
    write_plain(folder, NAME, signed_text(document), lasts=True)


def _describe(run: PlannedRun) -> dict[str, Any]:
    facts = {key: getattr(run, key) for key in ("id", "scenario", "seed", "avatars", "control_frames", "control_rate")}
    outputs = run.outputs.model_dump(mode="json", exclude_none=True)
    return {**facts, "policies": list(run.policies), "outputs": outputs, "estimate": asdict(run.estimate)}


def is_batch(folder: Path) -> bool:
    """Whether a folder is that of a batch."""
    return (folder / NAME).is_file()


def read_plan(folder: Path) -> Plan:
    """Return the plan in the folder of a batch.

    Raises:
        BatchError: There is none, or it is damaged.
    """
    path = folder / NAME
    try:
        with open_plain(folder, NAME) as file:
            document = json.loads(file.read().decode("utf-8"))
        if document["format"] != FORMAT or document["version"] != VERSION or document["checksum"] != checksum(document):
            raise ValueError("its checksum does not fit what it says")
        runs = [_read_run(facts) for facts in document["runs"]]
        combinations = [
            (Combination(one["scenario"], tuple(one["indices"]), one["values"]), one["run"])
            for one in document["combinations"]
        ]
    except FileNotFoundError:
        raise BatchError(f"{folder}: no {NAME} here, so this is no batch") from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise BatchError(f"{path}: is damaged: {error}") from None
    return Plan(
        document["name"], document["description"], tuple(document["scenarios"]), tuple(document["axes"]),
        tuple(combinations), {run.id: run for run in runs}, document["frames_per_task"], document["policies"],
        document["environment"],
    )  # fmt: skip


def _read_run(facts: Mapping[str, Any]) -> PlannedRun:
    outputs = Outputs.model_validate_json(json.dumps(facts["outputs"]))
    rest = {key: facts[key] for key in ("id", "scenario", "seed", "avatars", "control_frames", "control_rate")}
    return PlannedRun(
        **rest, outputs=outputs, policies=tuple(facts["policies"]), estimate=Estimate(**facts["estimate"])
    )
