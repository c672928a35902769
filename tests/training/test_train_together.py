"""Two processes that want the same policy train it once."""

import json
import os
import subprocess
import sys

PROGRAM = """
import json, sys
from crowdsim.training.train import train_recipe
stages = []
folder, trained = train_recipe(sys.argv[1], progress=lambda stage, done, total: stages.append(stage))
print(json.dumps([trained, stages[0] if stages else "", (folder / "policy.json").is_file()]))
"""
RECIPE = """
version: 1
motion:
  performer:
    seconds: 8
    seed: 1
graph:
  threshold: 0.3
  spacing: 0.3
  branching: 6
behaviours:
  approach:
    axes:
      distance:
        count: 6
      bearing:
        count: 6
    rewards:
      - kind: proximity
"""


def test_one_of_two_processes_trains_and_the_other_waits_for_it(tmp_path):
    (tmp_path / "small.yaml").write_text(RECIPE)
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(tmp_path / "small.yaml")],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        for _ in range(2)
    ]  # fmt: skip
    outcomes = []
    for process in processes:
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
        outcomes.append(json.loads(out))
    assert sorted(trained for trained, *_ in outcomes) == [False, True]
    assert all(written for *_, written in outcomes)
    assert all(first == "wait for another process that trains it" for trained, first, _ in outcomes if not trained)
    assert not list(tmp_path.rglob("*.lock"))
