"""Makes the tables of the documentation from ``benchmarks/results.json``.

    python docs/make_tables.py [--check]

A table stands between two markers, ``<!-- table: scenes -->`` and ``<!-- end -->``; what is between them is replaced.
Every figure comes from the JSON document. A figure that it does not have is ``not measured``; results of quick runs do
not count. ``--check`` writes nothing, lists the lines that differ, and exits with 1 if there are any.
"""

from __future__ import annotations

import argparse
import difflib
import json
import re
import sys
from pathlib import Path
from typing import Any

from _capture_tables import CAPTURE_TABLES
from _paper_tables import PAPER_TABLES
from _performance_tables import PERFORMANCE_TABLES
from _quality_tables import QUALITY_TABLES
from _results import Results
from _user_tables import USER_TABLES
from _view_tables import VIEW_TABLES

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path("benchmarks/results.json")
PAGES = {
    "README.md": USER_TABLES,
    "docs/quality.md": QUALITY_TABLES,
    "docs/performance.md": PERFORMANCE_TABLES,
    "docs/paper.md": PAPER_TABLES,
    "docs/own_capture.md": CAPTURE_TABLES,
    "docs/view.md": VIEW_TABLES,
}
"""Tables of each page: functions that return lines, by the name in the marker."""
MARKER = re.compile(r"<!-- (?:table: (?P<name>[\w-]+)|end) -->")


class MarkerError(Exception):
    """A page whose markers do not match its tables."""


def regenerate(page: str, text: str, results: Results) -> str:
    """Return the text of a page with its tables made anew.

    Raises:
        MarkerError: A marker is missing, unknown, repeated or unmatched.
    """
    lines: list[str] = []
    tables, seen, name = PAGES[page], set[str](), ""
    for number, line in enumerate(text.splitlines(), 1):
        found = MARKER.fullmatch(line)
        if found and bool(name) == bool(found["name"]):
            raise MarkerError(f"{page}:{number}: {line} {f'inside the table {name}' if name else 'without a table'}")
        if found and found["name"] not in (*tables, None):
            raise MarkerError(f"{page}:{number}: no table {found['name']}, there are {', '.join(tables)}")
        if found and found["name"] in seen:
            raise MarkerError(f"{page}:{number}: a second table {found['name']}")
        if found and found["name"]:
            name = found["name"]
            seen.add(name)
            lines += [line, "", *tables[name](results), ""]
        elif found:
            name = ""
        if not name:
            lines.append(line)
    if name:
        raise MarkerError(f"{page}: <!-- end --> is missing after the table {name}")
    for missing in sorted(set(tables) - seen):
        raise MarkerError(f"{page}: <!-- table: {missing} --> is missing")
    return "\n".join(lines) + "\n"


def differences(results: Results, root: Path = ROOT) -> list[str]:
    """Return the lines of all pages that differ from what the results give, as a diff."""
    changes: list[str] = []
    for page in PAGES:
        text = (root / page).read_text(encoding="utf-8")
        made = regenerate(page, text, results).splitlines()
        changes += difflib.unified_diff(text.splitlines(), made, page, f"{page} from {RESULTS}", lineterm="", n=0)
    return changes


def read(root: Path = ROOT) -> Results:
    """Return the committed results; none where there is no document."""
    path = root / RESULTS
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return Results(document)


def main() -> None:
    """Write the tables, or report where they differ."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing, list the lines that differ")
    options = parser.parse_args()
    results = read()
    try:
        changes = differences(results)
    except MarkerError as error:
        sys.exit(str(error))
    if options.check:
        print("\n".join(changes) or "the tables are up to date")
        sys.exit(1 if changes else 0)
    for page in PAGES:
        path = ROOT / page
        path.write_text(regenerate(page, path.read_text(encoding="utf-8"), results), encoding="utf-8")
    absent = [".".join(keys) for keys in results.asked if not results.has(*keys)]
    print(f"{len(PAGES)} pages written, {len(absent)} of {len(results.asked)} figures not measured")
    for figure in absent:
        print(f"  {figure}")


if __name__ == "__main__":
    main()
