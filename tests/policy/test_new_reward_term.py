"""One more reward term, or axis, is one new file and its place in a list; training and control know it then."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

TERM = '''"""Being behind the target."""

import math
from typing import Any, ClassVar, Literal, NamedTuple

from crowdsim.jit import kernel
from crowdsim.policy.terms.term import Term


class Wanted(NamedTuple):
    """How far behind the target [m], and one over sigma."""

    behind: Any
    shrink: Any


@kernel(inline=True)
def read(term, number):
    """Return the numbers of a record."""
    return Wanted(number(term.behind), number(1.0 / term.sigma))


@kernel(inline=True)
def gap(seen, wanted):
    """Return how far the avatar is from the place behind the target."""
    dx, dz = seen.dx - wanted.behind * seen.facing_sin, seen.dz - wanted.behind * seen.facing_cos
    return math.sqrt(dx * dx + dz * dz) * wanted.shrink


class BehindTerm(Term):
    """Being behind the target."""

    numbers: ClassVar[tuple[str, ...]] = ("behind", "sigma")
    at_frames: ClassVar[tuple[Any, Any] | None] = (read, gap)
    axes: ClassVar[tuple[str, ...]] = ("heading",)

    kind: Literal["behind"] = "behind"
    behind: float = 0.6
    sigma: float = 0.4
'''

AXIS = '''"""How fast the target moves."""

import math

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind


@kernel(inline=True)
def measure(target):
    """Return the speed of a target [m a control frame]."""
    return math.sqrt(target.vx * target.vx + target.vz * target.vz)


KIND = AxisKind(
    name="pace",
    unit="m",
    description="How far it moves in a control frame [m].",
    observed="Its velocity.",
    trained="It stays.",
    measure=measure,
    place=lambda target, pace: target._replace(vz=pace),
    lowest=lambda motion: 0.0,
    highest=lambda motion: 0.1,
)
'''

PROGRAM = """
import math
from dataclasses import replace

import numpy as np
import pytest
from avatar_fields import set_situations
from naive_policy import random_actions
from synthetic_policy import policy, with_headings

import crowdsim
from crowdsim.crowd.buffers import empty_scratch
from crowdsim.crowd.kernels.values import value_actions
from crowdsim.crowd.model import build_model as control_model
from crowdsim.errors import RecipeError
from crowdsim.policy.axes.axis import Target
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.kernels.axes import Corners
from crowdsim.policy.kernels.values import evaluate_actions
from crowdsim.policy.rewards import TargetBody
from crowdsim.policy.terms.behind import BehindTerm
from crowdsim.training.model import build_model
from crowdsim.training.recipe import BehaviourSpec

print(crowdsim.__file__)
term, body = BehindTerm(weight=1.5), TargetBody()
axes = {"distance": {"count": 4}, "heading": {"count": 6}, "pace": {"count": 3}}
spec = {"axes": axes, "rewards": [{"kind": "behind"}]}
assert list(BehaviourSpec.model_validate(spec).axes.given()) == ["distance", "heading", "pace"]


def plainly(actions, action, x, z, heading):
    total = 0.0
    for t, row in enumerate(range(actions.path_offsets[action], actions.path_offsets[action + 1]), start=1):
        px, pz, _ = actions.paths[row].tolist()
        away = math.hypot(x - px - 0.6 * math.sin(heading), z - pz - 0.6 * math.cos(heading))
        total += 1.5 * 0.97**t * math.exp(-away / 0.4)
    return total


# Training: what each action earns in each cell.
actions = random_actions(states=4)
distance, bearing = Axis("distance", 0.1, 1.5, 4), Axis("bearing", -math.pi, math.pi, 5, True)
grid = build_grid([distance, bearing, Axis("height", 1.2, 1.6, 2), Axis("heading", -math.pi, math.pi, 6, True)])
cells = grid.observed()
earned = build_model(actions, grid, (term,), body, 0.97).rewards(0, actions.action_count)
expected = [
    [plainly(actions, a, *where) for where in zip(cells.x, cells.z, cells.heading, strict=True)]
    for a in range(actions.action_count)
]
np.testing.assert_allclose(earned, expected, rtol=1e-4, atol=1e-6)
with pytest.raises(RecipeError, match="reward term 'behind' needs the axis 'heading', the grid has distance, bearing"):
    build_model(actions, build_grid([distance, bearing]), (term,), body, 0.97)

# Control and judging, on five axes.
chosen, draw = with_headings(policy(4, "v")), np.random.default_rng(2)
behaviours = []
for each in chosen.behaviours:
    wide = build_grid([*each.grid.axes, Axis("pace", 0.0, 0.1, 3)])
    table = draw.uniform(0, 1, len(each.table) * 3).astype(np.float32)
    behaviours.append(replace(each, terms=(term,), grid=wide, table=table))
assert len(behaviours[1].grid.axes) == 5
values = np.concatenate([each.table for each in behaviours])
chosen = replace(chosen, behaviours=tuple(behaviours), values=values)
model, tables = control_model([chosen]), chosen.lookup_tables()
scratch, corners, out = empty_scratch(model, 1, 20), Corners(np.empty(64, np.int64), np.empty(64)), np.empty(100)
states = draw.integers(chosen.actions.state_count, size=20)
seen = draw.uniform([-1.0, 1.2, -1.0, -0.05, -0.05, -3.0], [1.0, 1.7, 1.0, 0.05, 0.05, 3.0], (20, 6))
scratch.order[:], scratch.cohorts[:], scratch.policies[:], scratch.states[:] = np.arange(20), 0, 0, states
set_situations(scratch, np.column_stack([seen, np.full((20, 2), np.inf)]))
value_actions(model, np.ones((1, 2)), scratch, 0, 20)
for k in range(20):
    n = evaluate_actions(tables, np.ones(2), states[k], Target(*seen[k]), corners, out)
    np.testing.assert_allclose(scratch.values[k, :n], out[:n], rtol=1e-6, atol=1e-6)
"""


def listed(path: Path, line: str, before: str, after: str) -> None:
    """Put an import into a registry, and a name into its list."""
    text = path.read_text(encoding="utf-8")
    first = next(part for part in text.splitlines() if part.startswith("from crowdsim.policy."))
    assert before in text
    path.write_text(text.replace(first, f"{line}\n{first}", 1).replace(before, after), encoding="utf-8")


@pytest.mark.slow
def test_a_term_and_an_axis_are_a_file_each_and_their_places_in_lists(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "crowdsim", tmp_path / "crowdsim", ignore=shutil.ignore_patterns("__pycache__"))
    terms, axes = (tmp_path / "crowdsim" / "policy" / name for name in ("terms", "axes"))
    (terms / "behind.py").write_text(TERM, encoding="utf-8")
    (axes / "pace.py").write_text(AXIS, encoding="utf-8")
    line = "from crowdsim.policy.terms.behind import BehindTerm"
    listed(terms / "registry.py", line, "TransitionTerm, HitTerm)", "TransitionTerm, HitTerm, BehindTerm)")
    line = "from crowdsim.policy.axes.pace import KIND as PACE"
    listed(axes / "registry.py", line, "VELOCITY, IMPACT)", "VELOCITY, IMPACT, PACE)")
    path = os.pathsep.join(map(str, (tmp_path, ROOT / "tests", ROOT / "tests" / "crowd")))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env={**os.environ, "PYTHONPATH": path}, cwd=tmp_path, text=True,
        capture_output=True, check=False, timeout=1200,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.split()[0]).is_relative_to(tmp_path)
