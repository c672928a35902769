"""The runs of a batch as a table: one row for each combination, for the report, CSV and Parquet."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdsim.batch.plan import Plan
from crowdsim.batch.results import is_done, read_result
from crowdsim.errors import OutputError

if TYPE_CHECKING:
    from pandas import DataFrame


def read_table(folder: Path, plan: Plan) -> DataFrame:
    """Return the runs of a batch as a table.

    Returns:
        A row for each combination, in the order of the plan: ``run``, ``scenario``, the swept keys, ``state``
        (``done``, ``failed`` or ``missing``), ``folder``, ``avatars``, ``control_frames``, then of runs that are done
        their statistics, the time of each stage as ``seconds.STAGE`` [s], ``peak_memory_bytes``, ``bytes`` and
        ``files``, and of those that failed ``task``, ``cause``, ``message``, ``attempts``, ``log`` and ``command``.

    Raises:
        BatchError: What came of a run is damaged.
    """
    from pandas import DataFrame

    facts = {id: _facts(folder, plan, id) for id in plan.runs}
    rows = []
    for combination, id in plan.combinations:
        values = {key: plain_value(value) for key, value in combination.values.items()}
        rows.append({"run": id, "scenario": combination.scenario, **values, **facts[id]})
    columns = list(dict.fromkeys(key for row in rows for key in row))
    table = DataFrame(rows, columns=columns)
    # Figures of which there is nothing to measure in any run.
    empty = [name for name in columns if table[name].isna().all()]
    return table.astype(dict.fromkeys(empty, float))


def _facts(folder: Path, plan: Plan, id: str) -> dict[str, Any]:
    from crowdsim.crowd.statistics import CrowdStatistics
    from crowdsim.take.measures import FightMeasures

    run, result = plan.runs[id], read_result(folder, id)
    state = "done" if is_done(folder, run, result) else "failed" if result.get("state") == "failed" else "missing"
    rest = {"state": state, "folder": run.folder, "avatars": run.avatars, "control_frames": run.control_frames}
    if "seed" not in {key for axis in plan.axes for key in axis}:
        rest["seed"] = run.seed
    if state == "done":
        stages = {f"seconds.{stage}": seconds for stage, seconds in result["seconds"].items()}
        figures = [one.name for kind in (FightMeasures, CrowdStatistics) for one in fields(kind)]
        statistics = {key: result["statistics"].get(key) for key in figures if key not in rest}
        sizes = {key: result[key] for key in ("peak_memory_bytes", "bytes", "files")}
        return {**rest, **statistics, **stages, **sizes}
    if state == "failed":
        return {**rest, **{key: result.get(key) for key in ("task", "cause", "message", "attempts", "log", "command")}}
    return rest


def plain_value(value: Any) -> Any:
    """Return a value of an axis as a number or text."""
    return value if isinstance(value, int | float | str) or value is None else json.dumps(value)


def write_table(table: DataFrame, path: Path) -> list[Path]:
    """Write a table as CSV, and as Parquet beside it where pyarrow is installed; return the files.

    Raises:
        OutputError: It cannot be written.
    """
    harmless = table.map(_harmless).rename(columns=_harmless)
    written = [_write(path, lambda part: harmless.to_csv(part, index=False))]
    if find_spec("pyarrow") is not None:
        mixed = [name for name in table.columns if table[name].map(type).nunique() > 1 and table[name].dtype == object]
        plain = table.astype({name: "string" for name in mixed})
        written.append(_write(path.with_suffix(".parquet"), lambda part: plain.to_parquet(part, engine="pyarrow")))
    return written


def _harmless(value: Any) -> Any:
    """Return a value of which no spreadsheet makes a formula: text that looks like one has a quote before it."""
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value


def _write(path: Path, write: Callable[[Path], object]) -> Path:
    part = path.with_name(f".{path.name}.part")
    try:
        write(part)
        os.replace(part, path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path
