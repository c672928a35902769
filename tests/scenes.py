"""Small scenarios, and the command line as users see it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any
from unittest import mock

import typer
import yaml

from crowdsim import cli

# Made anew, it takes longer than many a command.
APP = typer.main.get_command(cli.app)


def scene(**changes: Any) -> dict[str, Any]:
    """Plain data of a scenario: four boxers for 40 control frames, with keys changed or added."""
    result = {
        "version": 1,
        "name": "four",
        "seed": 5,
        "duration": 40,
        "types": {"boxer": {"policy": "tiny"}},
        "groups": [
            {"name": "red", "team": "red", "type": "boxer", "count": 2,
             "placement": {"kind": "line", "start": [-1, 0.7], "end": [1, 0.7]}, "facing": "enemies"},
            {"name": "blue", "team": "blue", "type": "boxer", "count": 2,
             "placement": {"kind": "line", "start": [-1, -0.7], "end": [1, -0.7]}, "facing": "enemies"},
        ],
        "opponents": {"kind": "other_team"},
    }  # fmt: skip
    return {**result, **changes}


def write_scene(path: Path, **changes: Any) -> Path:
    """Write a scenario to a file."""
    path.write_text(yaml.safe_dump(scene(**changes), sort_keys=False), encoding="utf-8")
    return path


def crowdsim(*arguments: str | Path) -> int:
    """Run the command line in this process and return its exit code."""
    with mock.patch.object(sys, "argv", ["crowdsim", *map(str, arguments)]), mock.patch.object(cli, "app", APP):
        try:
            cli.main()
        except SystemExit as leave:
            return int(leave.code or 0)
    return 0
