"""A long run: does memory grow, is anyone lost or stuck, and what do checkpoints cost?

    python benchmarks/soak.py [--json] [--quick] [--frames N]

``soak``: a million control frames of ``brawl_30`` (18 hours and a half), written as a take, with checkpoints.
``memory_growth`` is how much the process's memory grows at most after the first tenth, as a share of what it is then.
``not_finite`` counts positions that are no finite numbers. For longer than a minute at a stretch, ``lost_avatars`` are
more than 1 m outside the arena, and ``stuck_avatars`` are out of their opponent's reach, or stay within 5 cm.

``checkpoints``: the share of a run's wall time that checkpoints take, in the long run and in ``brawl_30`` as it ships
without its outputs.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from _quick import command_line, small_policies

from crowdsim.core.types import Array
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.runner import run_to
from crowdsim.scenario.parts import CircleArena
from crowdsim.scenario.scenario import Scenario, load_scenario
from crowdsim.take.measures import OUT_OF_REACH
from crowdsim.take.store import open_take
from crowdsim.take.take import Take

FRAMES, QUICK_FRAMES = 1_000_000, 3000
CHUNK = 4096
MINUTE = 60.0
OUTSIDE, STILL = 1.0, 0.05


class Memory:
    """Notes the memory of this process as a run advances; called with stage, done and total."""

    def __init__(self) -> None:
        self._process = psutil.Process()
        self._begun, self._most = 0, 0

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Note it."""
        if stage != "control" or done < total // 10:
            return
        now = self._process.memory_info().rss
        self._begun = self._begun or now
        self._most = max(self._most, now)

    @property
    def growth(self) -> float:
        """Growth after the first tenth, as a share."""
        return (self._most - self._begun) / self._begun


class Whereabouts:
    """Looks for avatars that are lost or stuck, some frames at a time.

    Args:
        count: Number of avatars.
        rate: Control frames a second.
        arena: Centre x and z, and radius [m].
    """

    def __init__(self, count: int, rate: float, arena: tuple[float, float, float]) -> None:
        self._limit, self._arena = int(MINUTE * rate), arena
        self._apart, self._still, self._outside = np.zeros((3, count), np.int64)
        self._anchor = np.full((2, count), np.inf)
        self.not_finite = 0
        self.lost, self.stuck = np.zeros((2, count), bool)

    def add(self, x: Array, z: Array, opponent: Array) -> None:
        """Look at more frames: positions [m] and opponents. Shape (n, N) each."""
        self.not_finite += int(np.count_nonzero(~np.isfinite(x)) + np.count_nonzero(~np.isfinite(z)))
        centre_x, centre_z, radius = self._arena
        outside = np.hypot(x - centre_x, z - centre_z) > radius + OUTSIDE
        rows = np.arange(len(x))[:, None]
        distance = np.hypot(x - x[rows, opponent], z - z[rows, opponent])
        for k in range(len(x)):
            self._apart = np.where(distance[k] > OUT_OF_REACH, self._apart + 1, 0)
            moved = np.hypot(x[k] - self._anchor[0], z[k] - self._anchor[1]) > STILL
            self._still = np.where(moved, 0, self._still + 1)
            self._anchor = np.where(moved, np.stack([x[k], z[k]]), self._anchor)
            self._outside = np.where(outside[k], self._outside + 1, 0)
            self.lost |= self._outside > self._limit
            self.stuck |= (self._apart > self._limit) | (self._still > self._limit)


def soak(frames: int, folder: Path) -> tuple[dict[str, Any], float]:
    """Return the figures of the long run, and the share of checkpoints."""
    scenario = load_scenario("brawl_30", ["outputs={}"], frames=frames)
    memory = Memory()
    run_to(folder, scenario, threads=1, progress=memory)
    take = open_take(folder)
    places = look(scenario, take)
    seconds = read_manifest(folder)["seconds"]
    figures = {
        "frames": take.frame_count,
        "memory_growth": memory.growth,
        "not_finite": places.not_finite,
        "lost_avatars": int(places.lost.sum()),
        "stuck_avatars": int(places.stuck.sum()),
        "control_seconds": seconds["control"],
        "wall_seconds": seconds["total"],
    }
    return figures, seconds["checkpoints"] / seconds["total"]


def look(scenario: Scenario, take: Take) -> Whereabouts:
    """Look at all frames of a take."""
    arena = scenario.arena
    assert isinstance(arena, CircleArena)
    places = Whereabouts(take.avatar_count, take.control_rate, (*arena.centre, arena.radius))
    for first in range(0, take.frame_count, CHUNK):
        rows = slice(first, first + CHUNK)
        places.add(take.x[rows], take.z[rows], take.opponent[rows])
    return places


def checkpoint_share(folder: Path) -> float:
    """Return the share of a run of ``brawl_30`` without outputs that checkpoints take."""
    run_to(folder, load_scenario("brawl_30", ["outputs={}"]), threads=1)
    seconds = read_manifest(folder)["seconds"]
    return float(seconds["checkpoints"] / seconds["total"])


def measure(frames: int) -> dict[str, Any]:
    """Return all figures."""
    with tempfile.TemporaryDirectory() as name:
        brawl = checkpoint_share(Path(name) / "brawl")
        figures, share = soak(frames, Path(name) / "soak")
    return {"soak": figures, "checkpoints": {"brawl_30": brawl, "soak": share}}


def main() -> None:
    """Measure and print."""
    parser = command_line(__doc__, "few frames and a small policy: it runs, no more")
    parser.add_argument("--frames", type=int, default=FRAMES, help="control frames")
    options = parser.parse_args()
    with small_policies(wanted=options.quick):
        report = measure(QUICK_FRAMES if options.quick else options.frames)
    if options.json:
        print(json.dumps(report, indent=2))
        return
    for part, figures in report.items():
        print(part)
        for name, value in figures.items():
            print(f"  {name:<16} {value:.4g}" if isinstance(value, float) else f"  {name:<16} {value:,}")


if __name__ == "__main__":
    main()
