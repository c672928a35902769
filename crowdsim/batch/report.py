"""The report of a batch: one HTML file that needs nothing else, and the runs as a table beside it."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from crowdsim.batch.attempts import KINDS, log_tail
from crowdsim.batch.curves import COLOURS, curve_of, draw_curves
from crowdsim.batch.documents import read_bytes
from crowdsim.batch.plan import REPORT, Plan
from crowdsim.batch.results import is_done, read_result
from crowdsim.files import exists_plain, make_folder, write_plain, write_text
from crowdsim.scenario.names import harmless_cell

if TYPE_CHECKING:
    from pandas import DataFrame

INDEX, SUMMARY, THUMBNAILS = "index.html", "summary.csv", "thumbnails"
MAXIMUM_ROWS = 500
"""Runs that the page lists; the table beside it has all."""
MAXIMUM_THUMBNAILS = 24
_SEED = "seed"
_FIGURES = {
    "hits_per_minute_per_avatar": "hits per avatar per minute",
    "thrown_per_minute": "strikes thrown per avatar per minute",
    "landed_share": "strikes that land, share",
    "blocked_share": "strikes that are blocked, share",
    "evaded_share": "strikes that are evaded, share",
    "distance_median": "median distance to the opponent [m]",
    "out_of_reach_share": "opponent out of reach, share of time",
    "overlap_share": "overlap, share of avatar-frames",
    "transitions_per_second": "transitions per avatar per second",
    "first_landed_seconds": "first strike that lands [s]",
}
_COSTS = {
    "seconds.total": "time [s]",
    "seconds.control": "control [s]",
    "peak_memory_bytes": "peak memory [MB]",
    "bytes": "on disk [MB]",
}
_MEGABYTES = ("peak_memory_bytes", "bytes")


def read_table(folder: Path, plan: Plan) -> DataFrame:
    """Return the runs of a batch as a table.

    Returns:
        A row for each combination, in the order of the plan: ``run``, ``scenario``, the swept keys, ``state``
        (``done``, ``failed`` or ``missing``), ``folder``, ``avatars``, ``control_frames``, then of runs that are done
        their statistics, the time of each stage as ``seconds.STAGE`` [s], ``peak_memory_bytes``, ``bytes`` and
        ``files``, and of those that failed ``task``, ``cause``, ``message``, ``attempts``, ``log`` and ``command``.
    """
    from pandas import DataFrame

    from crowdsim.crowd.statistics import CrowdStatistics
    from crowdsim.take.measures import FightMeasures

    figures = [one.name for kind in (FightMeasures, CrowdStatistics) for one in fields(kind)]
    facts = {id: _facts(folder, plan, id, figures) for id in plan.runs}
    rows = []
    for combination, id in plan.combinations:
        values = {key: plain_value(value) for key, value in combination.values.items()}
        rows.append({"run": id, "scenario": combination.scenario, **values, **facts[id]})
    columns = list(dict.fromkeys(key for row in rows for key in row))
    table = DataFrame(rows, columns=columns)
    # Figures of which there is nothing to measure in any run.
    empty = [name for name in columns if table[name].isna().all()]
    return table.astype(dict.fromkeys(empty, float))


def _facts(folder: Path, plan: Plan, id: str, figures: Sequence[str]) -> dict[str, Any]:
    run, result = plan.runs[id], read_result(folder, id)
    state = "done" if is_done(folder, run, result) else "failed" if result.get("state") == "failed" else "missing"
    rest = {"state": state, "folder": run.folder, "avatars": run.avatars, "control_frames": run.control_frames}
    if _SEED not in plan.batch.swept:
        rest["seed"] = run.seed
    if state == "done":
        stages = {f"seconds.{stage}": seconds for stage, seconds in result["seconds"].items()}
        statistics = {key: result["statistics"].get(key) for key in figures if key not in rest}
        sizes = {key: result[key] for key in ("peak_memory_bytes", "bytes", "files")}
        return {**rest, **statistics, **stages, **sizes}
    if state == "failed":
        return {**rest, **{key: result.get(key) for key in ("task", "cause", "message", "attempts", "log", "command")}}
    return rest


def plain_value(value: Any) -> Any:
    """Return a value of an axis as a number or text."""
    return value if isinstance(value, int | float | str) or value is None else json.dumps(value)


def write_table(table: DataFrame, path: Path) -> None:
    """Write a table as CSV, and as Parquet beside it where pyarrow is installed."""
    write_text(path, table.map(harmless_cell).rename(columns=harmless_cell).to_csv(index=False))
    if find_spec("pyarrow") is not None:
        mixed = [name for name in table.columns if table[name].map(type).nunique() > 1 and table[name].dtype == object]
        plain = table.astype({name: "string" for name in mixed})
        write_plain(path.parent, path.with_suffix(".parquet").name, plain.to_parquet(engine="pyarrow"))


def thumbnail_path(folder: Path, id: str) -> Path:
    """Return the small picture of a run."""
    return folder / REPORT / THUMBNAILS / f"{id}.png"


def pick_thumbnails(plan: Plan) -> list[str]:
    """Return the runs of which there are small pictures, evenly picked where there are many."""
    ids = list(plan.runs)
    every = max(1, -(-len(ids) // MAXIMUM_THUMBNAILS))
    return ids[::every]


def write_report(folder: Path, plan: Plan) -> Path:
    """Write ``report/index.html``, ``summary.csv`` and ``summary.parquet``; return the page."""
    from jinja2 import Environment, PackageLoader

    table = read_table(folder, plan)
    make_folder(folder / REPORT)
    write_table(table, folder / REPORT / SUMMARY)
    environment = Environment(loader=PackageLoader("crowdsim.batch", "."), autoescape=True, trim_blocks=True)
    done = table[table["state"] == "done"]
    text = environment.get_template("report.html.j2").render(
        plan=plan,
        counts=table.drop_duplicates("run")["state"].value_counts().to_dict(),
        total=len(plan.runs),
        keys=plan.batch.swept,
        curves=_sweep_curves(done, plan),
        statistics=_grouped(done, plan, _FIGURES),
        costs=_grouped(done, plan, _COSTS),
        totals=_totals(done),
        failures=_failures(folder, table),
        causes=KINDS,
        rows=table.head(MAXIMUM_ROWS).where(table.notna(), None).to_dict("records"),
        more=max(0, len(table) - MAXIMUM_ROWS),
        figures=_FIGURES,
        thumbnails=_thumbnails(folder, plan),
        reports=_reports(folder, plan, table["run"].head(MAXIMUM_ROWS)),
    )
    write_text(folder / REPORT / INDEX, text)
    return folder / REPORT / INDEX


def _groups(plan: Plan) -> list[str]:
    """Return the columns that group runs: swept keys but the seed, and the scenario where there are several."""
    named = ["scenario"] if len(plan.batch.scenarios) > 1 else []
    return named + [key for key in plan.batch.swept if key != _SEED]


def _sweep_curves(done: DataFrame, plan: Plan) -> list[dict[str, Any]]:
    """Return the pictures of every figure against every key that is swept over numbers."""
    pictures = []
    for key in [key for key in _groups(plan) if key != "scenario"]:
        if not all(isinstance(value, int | float) for value in done[key]) or done[key].nunique() < 2:
            continue
        partners = next((set(axis) for axis in plan.batch.axes if key in axis), set())
        others = [name for name in _groups(plan) if name not in partners]
        parts = list(done.groupby(others, sort=False)) if others else [((), done)]
        for figure, title in {**_FIGURES, "seconds.total": "time of a run [s]"}.items():
            if figure not in done or not done[figure].notna().any():
                continue
            curves = []
            for (label, part), colour in zip(parts, COLOURS, strict=False):
                name = ", ".join(f"{name} {value}" for name, value in zip(others, label, strict=True))
                curves.append(curve_of(name, colour, part[key].tolist(), part[figure].tolist()))
            curves = [curve for curve in curves if len(curve.x) > 1]
            if curves:
                legend = [(curve.label, curve.colour) for curve in curves if curve.label]
                hidden = max(0, len(parts) - len(COLOURS))
                pictures.append({"svg": draw_curves(curves, title, key), "legend": legend, "hidden": hidden})
    return pictures


def _grouped(done: DataFrame, plan: Plan, columns: Mapping[str, str]) -> dict[str, Any]:
    """Return mean and spread of columns over the runs that differ in their seeds alone."""
    by = _groups(plan)
    shown = [name for name in columns if name in done and done[name].notna().any()]
    rows = []
    for label, part in list(done.groupby(by, sort=False)) if by else [((), done)]:
        cells = []
        for name in shown:
            values = part[name].dropna().astype(float) / (1e6 if name in _MEGABYTES else 1.0)
            cells.append((values.mean(), values.std() if len(values) > 1 else None) if len(values) else None)
        rows.append({"label": [str(value) for value in label], "runs": len(part), "cells": cells})
    return {"by": by, "titles": [columns[name] for name in shown], "rows": rows[:MAXIMUM_ROWS]}


def _totals(done: DataFrame) -> dict[str, float]:
    """Return what all runs took together."""
    once = done.drop_duplicates("run")
    stages = [name for name in once.columns if name.startswith("seconds.") and name != "seconds.total"]
    found = {name.removeprefix("seconds."): float(once[name].sum()) for name in stages}
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _failures(folder: Path, table: DataFrame) -> list[dict[str, Any]]:
    """Return the runs that failed, those of one cause together, each with the end of its log."""
    failed = table[table["state"] == "failed"].drop_duplicates("run")
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in failed.to_dict("records"):
        result = read_result(folder, row["run"])
        groups.setdefault(row["cause"], []).append({**row, "tail": log_tail(folder, result)})
    return [{"cause": cause, "runs": runs} for cause, runs in sorted(groups.items(), key=lambda item: -len(item[1]))]


def _reports(folder: Path, plan: Plan, ids: Iterable[str]) -> dict[str, str]:
    """Return where the reports of runs are that have one, as seen from the page, by run."""
    pages = {id: f"{plan.runs[id].folder}/report.html" for id in ids}
    return {id: f"../{quote(page)}" for id, page in pages.items() if exists_plain(folder, page)}


def _thumbnails(folder: Path, plan: Plan) -> list[dict[str, str]]:
    """Return the small pictures that there are, with what they show."""
    combinations = {id: str(one) for one, id in reversed(plan.combinations)}
    found = []
    for id in pick_thumbnails(plan):
        picture = read_bytes(folder, f"{REPORT}/{THUMBNAILS}/{id}.png")
        if picture:
            data = base64.b64encode(picture).decode("ascii")
            found.append({"image": f"data:image/png;base64,{data}", "label": combinations.get(id, id)})
    return found
