"""What victims do after the blow that fells them, how falls and ways to lie differ, who looks, and what fills breaks.

    python benchmarks/consequences.py [--mocap DIR] [--json] [--quick]

From takes and BVH files of whole runs of five seeds; ``_fights/consequences.py`` defines the figures and their goals.
Those that are missed stand between asterisks.
"""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from _fights import breaks, consequences
from _quick import command_line, small_policies

from crowdsim.crowd.model_falls import captured_starts
from crowdsim.runs.runner import run_to
from crowdsim.scenario.scenario import load_scenario
from crowdsim.training.train import ready_policy

RUNS = (
    ("brawl_last_standing", "brawl_last_standing", ()),
    ("bout", "bout", ()),
    ("bout, breaks", "bout", (*breaks.SCENE, "duration=40s")),
)
"""Names, scenarios and overrides of runs whose files are measured."""
SEEDS = 5
"""Seeds of each, from 1 on."""
QUICK: dict[str, Any] = {"frames": 300, "fraction": 0.2}
"""What is run of a scenario with ``--quick``."""


def measure(mocap: Path | None, quick: bool = False) -> dict[str, Any]:
    """Return the figures of each of ``RUNS``, by name."""
    policy = ready_policy("boxer", mocap, threads=2)
    assert policy.falls is not None
    motion = captured_starts(policy, policy.falls.fall)
    files = ("outputs.ply=null", "outputs.bvh.fps=60")
    outcome: dict[str, Any] = {}
    for name, scene, overrides in RUNS:
        runs = []
        for seed in range(1, 2 if quick else SEEDS + 1):
            with tempfile.TemporaryDirectory() as folder:
                changes = QUICK if quick and "breaks" not in name else {}
                scenario = load_scenario(scene, (*files, *overrides), seed=seed, **changes)
                run_to(Path(folder) / "run", scenario, mocap=mocap)
                runs.append(consequences.read_posed(Path(folder) / "run"))
        if "breaks" in name:
            outcome[name] = consequences.measure_break_poses(runs)
        else:
            outcome[name] = consequences.measure_consequences(runs, policy.falls.fall, motion)
    return outcome


def main() -> None:
    parser = command_line(
        "What follows knock-downs, and what fills breaks?", "seconds: six avatars, 20 s, small policies"
    )
    parser.add_argument("--mocap", type=Path, default=os.environ.get("CROWDSIM_MOCAP"), help="folder of capture")
    options = parser.parse_args()
    with small_policies(falls=True, wanted=options.quick):
        outcome = measure(options.mocap, options.quick)
    print(json.dumps(outcome, indent=2) if options.json else "\n".join(consequences.lines(outcome)))


if __name__ == "__main__":
    main()
