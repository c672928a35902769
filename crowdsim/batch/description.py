"""Batch files: scenarios, axes, exclusions and outputs of many runs."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, model_validator

from crowdsim import assets
from crowdsim.config.files import Faults, Finding, StrictModel, load_model, validate
from crowdsim.config.reference import reference_page
from crowdsim.config.schema import Expected, join
from crowdsim.config.tree import Document, Loc, Mark, read_document
from crowdsim.core.types import FileName
from crowdsim.errors import BatchError, nearest
from crowdsim.scenario.outputs import Outputs
from crowdsim.scenario.parts import Name

MAXIMUM_RUNS = 100_000
SEGMENT = 240
"""Pictures that are encoded together; tasks draw whole segments (``crowdsim.render.segments``)."""

_KEY = re.compile(r"[^.\[\]=]+(\.[^.\[\]=]+|\[\d+\])*")
_RANGE = re.compile(r"\s*(\d{1,18})\s*:\s*(\d{1,18})\s*")

Axis = dict[str, Sequence[Any]]
"""Values by key, equally many, which change together; the first key names the axis."""
Values = Annotated[list[Any] | str, Expected("a list of values, or text such as 0:10 for whole numbers")]


@dataclass(frozen=True)
class Combination:
    """One scenario with one value of every axis: index of the value on each axis, and the values by key."""

    scenario: str
    indices: tuple[int, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return it in words."""
        return ", ".join([self.scenario, *(f"{key}={value}" for key, value in self.values.items())])


class Batch(StrictModel):
    """Many runs: every scenario with every value of every axis."""

    version: Literal[1] = Field(description="Version of this format.")
    name: Name = Field(description="Name of the batch, and of its folder.")
    description: str = Field(default="", description="What the batch is for, in words.")
    scenarios: tuple[str, ...] = Field(
        min_length=1, description="Scenario files, in the folder of this file, or names of scenarios."
    )
    axes: tuple[dict[str, Values], ...] = Field(
        default=(),
        description="Keys of the scenarios, such as `groups[0].count`, each with a list of values or with text such as "
        "`0:10` for the whole numbers from 0 to 9. Keys of one item change together, those of several items are "
        "multiplied.",
    )
    set: tuple[str, ...] = Field(
        default=(),
        description="Other values for all scenarios, text such as `groups[0].count=12` each; the option `--set` adds "
        "to them.",
    )
    exclude: tuple[dict[str, Any], ...] = Field(
        default=(),
        description="Combinations that are left out: values, or lists of them, by key; `scenario` is a key too.",
    )
    outputs: Outputs | None = Field(
        default=None,
        description="Outputs of all runs, in place of those that the scenarios name; null: those that they name.",
    )
    frames_per_task: int = Field(
        default=SEGMENT,
        ge=SEGMENT,
        le=1_000_000,
        multiple_of=SEGMENT,
        description="Pictures that one task draws; the pictures of a run are drawn by several tasks at once.",
    )

    _document: Document = PrivateAttr(default_factory=lambda: Document(""))
    _folder: Path = PrivateAttr(default=Path())

    @model_validator(mode="after")
    def _check(self) -> Batch:
        findings = [*_axis_findings(self.axes), *_scenario_findings(self.scenarios), *_set_findings(self)]
        if not findings:
            findings = [*_exclusion_findings(self)]
            count = len(self.scenarios) * math.prod(_length(axis) for axis in self.all_axes)
            if count > MAXIMUM_RUNS:
                findings.append(Finding(("axes",), f"ask for {count:,} runs, expected at most {MAXIMUM_RUNS:,}"))
        if findings:
            raise Faults(findings)
        return self

    @property
    def all_axes(self) -> list[Axis]:
        """The axes, with the values that ranges stand for."""
        return [{key: _read_values(values) for key, values in axis.items()} for axis in self.axes]

    @property
    def swept(self) -> list[str]:
        """The keys of all axes."""
        return [key for axis in self.axes for key in axis]

    def combinations(self) -> Iterator[Combination]:
        """Yield every scenario with every value of every axis, the last axis first, but for what is excluded."""
        axes = self.all_axes
        for scenario in self.scenarios:
            for indices in itertools.product(*(range(_length(axis)) for axis in axes)):
                values = {key: at[i] for axis, i in zip(axes, indices, strict=True) for key, at in axis.items()}
                if not any(_has({"scenario": scenario, **values}, rule) for rule in self.exclude):
                    yield Combination(scenario, indices, values)

    def place(self, finding: Finding) -> Finding:
        """Return a finding with its position in the batch file, or with the option that it comes from."""
        return self._document.place(finding)

    def find_scenario(self, name: str) -> Path:
        """Return the file of one of the scenarios."""
        beside = self._folder / name
        return beside if beside.is_file() else assets.find_scenario(name)


def _length(axis: Axis) -> int:
    return len(next(iter(axis.values())))


def _has(values: Mapping[str, Any], rule: Mapping[str, Any]) -> bool:
    return all(values[key] in (wanted if isinstance(wanted, list) else [wanted]) for key, wanted in rule.items())


def _read_values(values: Any) -> Sequence[Any]:
    """Return the values that a list, or text such as ``0:10`` for whole numbers, stands for; nothing for other text."""
    if isinstance(values, str):
        match = _RANGE.fullmatch(values)
        return range(int(match[1]), int(match[2])) if match else ()
    return list(values)


def load_batch(path: FileName) -> Batch:
    """Return the batch that a file describes.

    Raises:
        BatchError: With every finding in a line of its own, and as the tuple ``findings``.
    """
    batch = load_model(path, Batch, BatchError)
    batch._document = read_document(Path(path).read_bytes(), str(path))
    batch._folder = Path(path).parent
    return batch


def batch_of_options(scenarios: Sequence[str], seeds: str | None = None, sweeps: Sequence[str] = ()) -> Batch:
    """Return the batch that options of the command line describe: scenarios, ``A:B`` or ``A,B``, ``KEY=VALUE,VALUE``.

    Raises:
        BatchError: With every finding in a line of its own, and as the tuple ``findings``.
    """
    given = [(f"--seeds {seeds}", f"seed={seeds}")] if seeds is not None else []
    given += [(f"--sweep {text}", text) for text in sweeps]
    axes: list[dict[str, Any]] = []
    marks: dict[Loc, tuple[Mark, Mark]] = {}
    findings: list[Finding] = []
    for source, text in given:
        key, equals, written = text.partition("=")
        is_range = _RANGE.fullmatch(written) is not None
        read = Document("", written) if is_range else read_document(f"[{written}]".encode("utf-8", "replace"), "")
        if not equals or not key or read.findings:
            what = "is no axis, expected KEY=VALUE,VALUE, such as groups[0].count=5,15,30"
            findings.append(Finding((), read.findings[0].message if read.findings else what, source=source))
            continue
        mark = (source, 0, 0)
        marks[("axes", len(axes))] = marks[("axes", len(axes), key)] = mark, mark
        axes.append({key: read.data or []})
    first = Path(scenarios[0]).stem if len(scenarios) == 1 else "batch"
    name = re.sub(r"[^A-Za-z0-9_-]", "_", first) + ("_batch" if len(scenarios) == 1 else "")
    data = {"version": 1, "name": name, "scenarios": list(scenarios), "axes": axes}
    if marks:
        marks[("axes",)] = next(iter(marks.values())) if len(given) == 1 else (("--sweep", 0, 0),) * 2
    document = Document("crowdsim batch", data, marks, findings=findings)
    batch = validate(document, Batch, BatchError)
    batch._document = document
    return batch


def with_overrides(batch: Batch, overrides: Sequence[str]) -> Batch:
    """Return a batch with other values for all its scenarios, ``KEY=VALUE`` each.

    Raises:
        BatchError: One is of an axis.
    """
    changed = batch.model_copy(update={"set": (*batch.set, *overrides)})
    for finding in _set_findings(changed):
        raise BatchError(f"--set {changed.set[finding.loc[1]]}: {finding.message}")
    return changed


def is_batch_file(name: str) -> bool:
    """Whether a file describes a batch rather than a scenario: it lists scenarios."""
    path = Path(name)
    if not path.is_file():
        return False
    data = read_document(path.read_bytes(), name).data
    return isinstance(data, dict) and bool({"scenarios", "axes"} & set(data))


def _axis_findings(axes: Sequence[dict[str, Any]]) -> Iterator[Finding]:
    known: dict[str, int] = {}
    for i, axis in enumerate(axes):
        if not axis:
            yield Finding(("axes", i), "is empty, expected a key with its values")
        lengths = {}
        for key, values in axis.items():
            at, read = ("axes", i, key), _read_values(values)
            lengths[key] = len(read)
            if not _KEY.fullmatch(key):
                yield Finding(at, "is no key of a scenario, expected one such as seed or groups[0].count", of_key=at)
            elif key in known:
                yield Finding(at, f"is an axis already, see axes[{known[key]}]; expected it once", of_key=at)
            elif re.match(r"outputs\b|name\b", key):
                yield Finding(at, "is the same for all runs, expected a key that changes what happens", of_key=at)
            elif not read:
                what = "is empty" if isinstance(values, list) else f"is {values!r}"
                yield Finding(at, f"{what}, expected a list of values, or text such as 0:10 for whole numbers")
            known.setdefault(key, i)
        first, count = next(iter(lengths.items()), ("", 0))
        for key, length in lengths.items():
            if length != count and 0 not in (length, count):
                what = f"has {length} values, expected {count} as {first} has, since they change together"
                yield Finding(("axes", i, key), what)


def _scenario_findings(scenarios: Sequence[str]) -> Iterator[Finding]:
    for i, name in enumerate(scenarios):
        if name in scenarios[:i]:
            yield Finding(("scenarios", i), f"is {name!r} like scenarios[{scenarios.index(name)}], expected it once")


def _set_findings(batch: Batch) -> Iterator[Finding]:
    for i, text in enumerate(batch.set):
        key = text.partition("=")[0]
        if key in batch.swept:
            yield Finding(("set", i), f"sets {key}, which is an axis; expected another key")


def _exclusion_findings(batch: Batch) -> Iterator[Finding]:
    values: Axis = {"scenario": batch.scenarios}
    for axis in batch.all_axes:
        values.update(axis)
    for i, rule in enumerate(batch.exclude):
        if not rule:
            yield Finding(("exclude", i), "is empty, expected values by key")
        for key, wanted in rule.items():
            at = ("exclude", i, key)
            if key not in values:
                what = f"is no axis, expected {join(values)}{nearest(key, values)}"
                yield Finding(at, what, of_key=at)
                continue
            for value in wanted if isinstance(wanted, list) else [wanted]:
                if value not in values[key]:
                    yield Finding(at, f"never is {value!r}, expected one of its values")


_HEAD = """# Batch files

Every key of a batch file, from the schema that checks it. Required keys have no default. [batch.md](batch.md) has an
example; `crowdsim batch FILE --dry-run` reports every error in a file, and lists its runs.

<!-- Written from the schema by crowdsim.batch.description; do not edit. -->
"""


def batch_schema() -> str:
    """Return the JSON Schema of batch files as text; editors complete and check batches by it."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Batch.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def batch_reference() -> str:
    """Return docs/batch_files.md: every key of a batch file with its type, its default and its meaning."""
    return reference_page(json.loads(batch_schema()), _HEAD)
