"""Tables of docs/own_capture.md: how surely faults of capture are found, and not seen where there are none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from _results import MISSING, NOT_MEASURED, Results


def faults(results: Results) -> list[str]:
    """Return what is found, repaired and refused of each fault."""
    found: Any = results.get("capture", "faults")
    measured = {} if found is MISSING else found
    rows = [
        [name, f"`{row['kind']}`", *(f"{row[key]} of {row['made']}" for key in ("found", "repaired", "refused"))]
        for name, row in measured.items()
    ]
    header = ["fault", "kind", "found", "repaired", "refused"]
    return results.table(header, rows or [[NOT_MEASURED] * len(header)], "capture")


def false_alarms(results: Results) -> list[str]:
    """Return findings about clean clips."""
    found: Any = results.get("capture", "clean")
    measured = {} if found is MISSING else found
    rows = [[name, str(row["files"]), str(row["alarms"])] for name, row in measured.items()]
    return results.table(["clean clips", "files", "false alarms"], rows or [[NOT_MEASURED] * 3], "capture")


CAPTURE_TABLES: dict[str, Callable[[Results], list[str]]] = {"faults": faults, "false_alarms": false_alarms}
