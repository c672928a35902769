"""What is so far from the origin that single precision would show is refused, where it is written."""

import re
from pathlib import Path

import numpy as np
import pytest
from scenes import crowdsim, scene, write_scene

from crowdsim.scenario.parts import FARTHEST

NUMBER = "expected a number from -4000 to 4000"
SHOWS = "expected x and z up to 4000 m: further away single precision shows"


def test_single_precision_is_fine_enough_as_far_as_positions_go() -> None:
    assert np.spacing(np.float32(FARTHEST)) <= 0.00025


@pytest.mark.parametrize(
    ("placement", "at", "what"),
    [
        ({"kind": "grid", "centre": [0, 50_000]}, "centre[1]", f"is 50000, {NUMBER}"),
        ({"kind": "line", "start": [-4000.5, 0], "end": [-4001, 0]}, "start[0]", f"is -4000.5, {NUMBER}"),
        ({"kind": "ring", "radius": 100_000}, "", f"avatar red_0 would be at 0, 100000, {SHOWS}"),
        ({"kind": "disc", "centre": [0, -3999], "radius": 9000, "distance": 5}, "", SHOWS),
        ({"kind": "grid", "spacing": 1000, "columns": 10}, "", f"avatar red_0 would be at 4500, 0, {SHOWS}"),
        ({"kind": "points", "file": "far.csv"}, "file",
         "far.csv: row 2 is 4001, 0, expected finite numbers up to 4000 m"),
    ],
)  # fmt: skip
def test_avatars_far_away_are_refused_where_they_are_placed(
    workplace: Path, capsys, placement: dict, at: str, what: str
) -> None:
    (workplace / "far.csv").write_text("0,0\n4001,0\n" + "1,1\n" * 8)
    group = {**scene()["groups"][0], "count": 10, "placement": placement}
    path = write_scene(workplace / "four.yaml", groups=[group, scene()["groups"][1]])
    line = path.read_text().splitlines().index("  placement:") + 1
    for command in ("validate", "run"):
        assert crowdsim(command, "four.yaml") == 2
        (error, *_) = capsys.readouterr().err.splitlines()
        found = re.fullmatch(r"four\.yaml:(\d+):\d+: groups\[0\]\.placement\.?(\S*): (.*)", error)
        assert found is not None, error
        assert line <= int(found[1]) <= line + 6
        assert found[2] == at
        assert found[3].endswith(what)
    assert not (workplace / "output").exists()


def test_targets_far_away_are_refused(workplace: Path, capsys) -> None:
    targets = {
        "a": {"kind": "circle", "centre": [0, 3000], "radius": 1500},
        "b": {"kind": "points", "points": [[1, 4001]]},
    }
    write_scene(workplace / "four.yaml", targets=targets)
    assert crowdsim("validate", "four.yaml") == 2
    assert [line.split(": ", 1)[1] for line in capsys.readouterr().err.splitlines()] == [
        "targets.a.radius: is 1500, so that the target would be at 4500, expected x and z up to 4000 m",
        f"targets.b.points[0][1]: is 4001, {NUMBER}",
    ]
