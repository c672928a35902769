"""The tables of the documentation are those that ``benchmarks/results.json`` gives."""

import copy
import importlib
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
COMMIT = "0123456789abcdef0123456789abcdef01234567"
WORST = {"first_landed_seconds": 7.0, "air_share": 0.05771, "landed_share": 0.45, "stuck_avatars": 0}
MEAN = {"first_landed_seconds": 2.5, "air_share": 0.0115, "landed_share": 0.55, "stuck_avatars": 0.0}
DOCUMENT: dict[str, Any] = {
    "benchmarks": {
        name: {"commit": COMMIT, "date": "2026-01-02T03:04:05+00:00", "machine": "2 cores, Any CPU", "quick": False,
               "results": results}
        for name, results in {
            "control": {"brawl_30": {"milliseconds": 9.8765}, "crowd_1m": {"milliseconds": 83.45}},
            "render": {"fps": {"30": 38.21, "1000": 14, "10000": 5.812}, "open3d": {"fps_30": None}},
            "scenes": {"duel": {**WORST, "mean": MEAN, "missed": []}},
            "graph": {"speed": [{"seconds": 1.049, "states": 1237}]},
        }.items()
    }
}  # fmt: skip


@pytest.fixture
def make_tables(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs"), *sys.path])
    return importlib.import_module("make_tables")


@pytest.fixture
def results(make_tables: ModuleType) -> Any:
    return make_tables.Results(copy.deepcopy(DOCUMENT))


def page(make_tables: ModuleType, name: str) -> str:
    return "".join(f"<!-- table: {table} -->\n<!-- end -->\n" for table in make_tables.PAGES[name])


def rows(make_tables: ModuleType, name: str, table: str, results: Any) -> dict[str, list[str]]:
    """Cells of a table by the first of their row."""
    lines = [line.strip("| ").split(" | ") for line in make_tables.PAGES[name][table](results) if line.startswith("|")]
    return {line[0]: [cell.strip() for cell in line[1:]] for line in lines}


def test_tables_of_the_documentation_match_the_results(make_tables: ModuleType) -> None:
    changes = make_tables.differences(make_tables.read())
    assert not changes, "run `make docs-tables`; these lines differ:\n" + "\n".join(changes)


def test_every_number_of_a_table_comes_from_the_results(make_tables: ModuleType) -> None:
    empty = make_tables.Results({})
    for tables in make_tables.PAGES.values():
        for table in tables.values():
            assert "not measured" in "\n".join(table(empty)).lower()
    assert all("not measured" in cell for cell in rows(make_tables, "docs/quality.md", "scenes", empty)["time within"
               " 1.3 m of the opponent"])  # fmt: skip


def test_figures_are_rounded_and_those_without_a_measurement_say_so(make_tables: ModuleType, results: Any) -> None:
    cells = rows(make_tables, "README.md", "figures", results)
    assert cells["control of 30 boxers for 67 s"][0] == "9.88 ms"
    assert cells["control of a million boxers (`crowd_1m`), one frame"][0] == "83.5 ms"
    assert cells["video at 1280x720 of 30 / 1,000 / 10,000 boxers, frames per second"] == [
        "38.2 / 14 / 5.81",
        "Open3D, 30 boxers: none",
    ]
    assert cells["1000 PLY clouds of 15,000 labelled points"][0] == "not measured"
    graph = rows(make_tables, "docs/performance.md", "graph", results)
    assert graph["437 s, as in the paper"] == ["1.05", "not measured", "1,237", "not measured"]
    assert set(graph["one hour"]) == {"not measured"}


def test_missed_goals_are_bold_and_name_the_goal(make_tables: ModuleType, results: Any) -> None:
    cells = rows(make_tables, "docs/quality.md", "scenes", results)
    assert cells["first strike landed after [s]"][0] == "**7.00 / 2.50** (at most 6.00)"
    assert cells["share of strikes thrown at the air"][0] == "**5.77 % / 1.15 %** (at most 2 %)"
    assert cells["share of strikes that land"][0] == "45 % / 55 %"
    assert cells["avatars out of reach for 10 s"][0] == "0"
    text = "\n".join(make_tables.PAGES["docs/quality.md"]["scenes"](results))
    assert "Goals missed: 2 of " in text
    assert "`duel`, first strike landed after [s]; `duel`, share of strikes thrown at the air." in text


def test_every_goal_has_a_cell(make_tables: ModuleType) -> None:
    tables = importlib.import_module("_quality_tables")
    for scene, goals in tables.GOALS.items():
        assert scene in (*tables.FIGHTS, *tables.CROWDS, *tables.RINGS)
        assert set(goals) <= set(tables.ALL_FIGURES)


def test_tables_state_when_and_where_they_were_measured(make_tables: ModuleType, results: Any) -> None:
    line = make_tables.PAGES["docs/quality.md"]["scenes"](results)[-1]
    assert line == "Measured on 2026-01-02 at commit `0123456` (2 cores, Any CPU): `scenes`."
    results.entries["scenes"]["commit"] = f"{COMMIT}-dirty"
    assert "`0123456` with local changes (" in make_tables.PAGES["docs/quality.md"]["scenes"](results)[-1]


def test_quick_results_count_as_not_measured(make_tables: ModuleType) -> None:
    document = copy.deepcopy(DOCUMENT)
    document["benchmarks"]["control"]["quick"] = True
    cells = rows(make_tables, "README.md", "figures", make_tables.Results(document))
    assert cells["control of 30 boxers for 67 s"][0] == "not measured"


def test_tables_are_replaced_and_all_else_is_kept(make_tables: ModuleType, results: Any) -> None:
    text = f"before\n\n{page(make_tables, 'README.md')}\nafter\n"
    made = make_tables.regenerate("README.md", text, results)
    assert made.startswith("before\n\n<!-- table: figures -->\n\n|")
    assert made.endswith("\n\n<!-- end -->\n\nafter\n")
    assert make_tables.regenerate("README.md", made, results) == made
    stale = made.replace("9.88", "1.23")
    assert make_tables.regenerate("README.md", stale, results) == made


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("<!-- table: scale -->\n<!-- end -->\n", ""), "<!-- table: scale --> is missing"),
        (lambda text: text.removesuffix("<!-- end -->\n"), "<!-- end --> is missing after the table batch"),
        (lambda text: text.replace("table: scale", "table: scales"), ":5: no table scales, there are control, stages"),
        (lambda text: text + "<!-- end -->\n", ": <!-- end --> without a table"),
        (lambda text: "<!-- table: scale -->\n" + text, ":2: <!-- table: control --> inside the table scale"),
        (lambda text: text + text, ": a second table control"),
    ],
)
def test_a_marker_that_is_wrong_is_reported(make_tables: ModuleType, results: Any, change: Any, message: str) -> None:
    name = "docs/performance.md"
    with pytest.raises(make_tables.MarkerError, match=re.escape(message)):
        make_tables.regenerate(name, change(page(make_tables, name)), results)


def test_differences_name_every_line(make_tables: ModuleType, results: Any, tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    for name in make_tables.PAGES:
        made = make_tables.regenerate(name, page(make_tables, name), results)
        (tmp_path / name).write_text(made, encoding="utf-8")
    assert make_tables.differences(results, tmp_path) == []
    readme = tmp_path / "README.md"
    readme.write_text(readme.read_text(encoding="utf-8").replace("9.88", "1.23"), encoding="utf-8")
    removed, added = make_tables.differences(results, tmp_path)[-2:]
    assert removed == "-| control of 30 boxers for 67 s | 1.23 ms | the paper: 9 s |"
    assert added == "+| control of 30 boxers for 67 s | 9.88 ms | the paper: 9 s |"


def test_committed_results_name_no_machine_and_no_path(make_tables: ModuleType) -> None:
    path = ROOT / make_tables.RESULTS
    if path.exists():
        text = path.read_text(encoding="utf-8")
        assert not re.search(r': "(/|\w:\\)', text)
        assert "NaN" not in text
