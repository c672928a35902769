"""The motion graph: how long it takes to build, and what its threshold, branching and spacing trade.

    python benchmarks/graph.py [--mocap DIR] [--json] [--quick]

Speed: graphs with default settings of 437 s (the paper's 6,453 frames at 15 Hz) and of an hour (54,000 frames) of the
performer, each in a process of its own for its peak memory, after a small graph has loaded the compiled kernels.

Trade-off: McCann and Pollard (2007) found that occasional poor transitions are crucial for responsiveness. For each
setting the table has the cost of transitions (mean and 95th percentile) and, without any learning, three response
times:

* `switch`: mean seconds from a random frame to a random frame by the shortest path, over frames that all graphs of the
  table contain;
* `go`: mean seconds until the body is within 0.3 m of a point 1 m away, in 8 directions;
* `strike`: mean seconds until a strike's fist comes within 0.21 m (a head's radius and the default tolerance) of a
  point in the region that strikes reach, ahead of the avatar.

`go` and `strike` search from random frames through all actions up to a horizon of 2 s, with four bodies for each 0.2 m
and 22.5 degrees at every frame. What is not reached counts as the horizon; the table also has the share reached.

Why the defaults are what they are (real capture, `fight_daz`):

* Threshold 0.25 m. Up to there costs rise more slowly than response times fall: from 0.15 to 0.25 m `strike` falls
  from 1.5 to 0.7 s while the mean cost rises from 0.10 to 0.14 m. Beyond it little is gained.
* Branching 12. The cheapest transitions of a frame suffice: at one mean cost, 0.25 m and 12 transitions per frame
  strike in 0.64 s, 0.20 m and 100 in 0.85 s with half as many actions again. Where a guard recurs all the time, as
  with the performer, the limit keeps the graph from having half a million actions.
* Spacing 0.2 s. Decisions after every frame strike 0.14 s sooner and `go` takes as long, for three times the states
  and therefore tables three times as large.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numba as nb
import numpy as np
from _quick import command_line
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from crowdsim.bvh.io import read_bvh, to_clip
from crowdsim.core.workers import CORES
from crowdsim.errors import MotionError
from crowdsim.graph.motion_graph import MotionGraph, build_graph
from crowdsim.graph.settings import GraphSettings
from crowdsim.graph.statistics import graph_statistics
from crowdsim.motion.database import MotionDatabase, build_database
from crowdsim.motion.measuring import measure_clips
from crowdsim.performer.session import perform

HORIZON = 2.0
SPOT_DISTANCE, SPOT_RADIUS = 1.0, 0.3
HEAD_AND_TOLERANCE = 0.21
BODIES_A_CELL = 4
TABLES: dict[str, list[dict[str, Any]]] = {
    "threshold": [{"threshold": metres} for metres in (0.10, 0.15, 0.20, 0.25, 0.30, 0.40)],
    "branching": [{"branching": branching} for branching in (4, 8, 12, 24, 100)],
    "same cost": [{"threshold": 0.20, "branching": 100}, {"threshold": 0.25, "branching": 12}],
    "spacing": [{"spacing": frames / 15} for frames in (0, 2, 3, 4, 5)],
}


@nb.njit(cache=True)
def search(
    start, horizon, offsets, nexts, firsts, lengths, ground, stride, first_strikes, strike_frames, strike_positions,
    spots, points, nodes, positions, keys, counts, out_spots, out_points,
):  # fmt: skip
    """Follow all actions from a state, by time, and write the first frame at which spots and points are reached."""
    out_spots[:] = horizon
    out_points[:] = horizon
    heads = np.full(horizon + 1, -1, np.int64)
    nodes[0, 0], nodes[0, 1], heads[0] = start, -1, 0
    positions[0] = 0.0
    used = 1
    mask = keys.shape[0] - 1
    for now in range(horizon):
        keys[:] = -1
        counts[:] = 0
        node = heads[now]
        while node >= 0:
            state, x, z, heading = nodes[node, 0], positions[node, 0], positions[node, 1], positions[node, 2]
            node = nodes[node, 1]
            turn = int((heading % (2 * math.pi)) / (math.pi / 8))
            key = ((math.floor(x / 0.2) + 64) * 128 + math.floor(z / 0.2) + 64) * 16 + turn
            slot = (key * 2654435761) & mask
            while keys[slot] >= 0 and keys[slot] != key:
                slot = (slot + 1) & mask
            keys[slot] = key
            counts[slot] += 1
            if counts[slot] > BODIES_A_CELL:
                continue
            for action in range(offsets[state], offsets[state + 1]):
                first, length = firsts[action], lengths[action]
                g = ground[(first - 1) * stride]
                aligned = heading - g[2]
                cos, sin = math.cos(aligned), math.sin(aligned)
                ax, az = x - (g[0] * cos + g[1] * sin), z - (g[1] * cos - g[0] * sin)
                for shown in range(length):
                    then = now + shown + 1
                    if then >= horizon:
                        break
                    g = ground[(first + shown) * stride]
                    px, pz = ax + g[0] * cos + g[1] * sin, az + g[1] * cos - g[0] * sin
                    for k in range(spots.shape[0]):
                        if then < out_spots[k] and math.hypot(px - spots[k, 0], pz - spots[k, 1]) < SPOT_RADIUS:
                            out_spots[k] = then
                low, high = (first - 1) * stride, (first + length - 1) * stride
                for strike in range(first_strikes[first - 1], strike_frames.shape[0]):
                    frame = strike_frames[strike]
                    if frame > high:
                        break
                    then = now + math.ceil((frame - low) / stride)
                    if frame <= low or then >= horizon:
                        continue
                    g = ground[frame]
                    cs, sn = math.cos(g[2] + aligned), math.sin(g[2] + aligned)
                    place = strike_positions[strike]
                    fx = ax + g[0] * cos + g[1] * sin + place[0] * cs + place[2] * sn
                    fz = az + g[1] * cos - g[0] * sin + place[2] * cs - place[0] * sn
                    for k in range(points.shape[0]):
                        if then < out_points[k]:
                            gap = math.hypot(fx - points[k, 0], fz - points[k, 2])
                            if math.hypot(gap, place[1] - points[k, 1]) < HEAD_AND_TOLERANCE:
                                out_points[k] = then
                then = now + length
                if then < horizon and used < nodes.shape[0]:
                    g = ground[high]
                    nodes[used, 0], nodes[used, 1] = nexts[action], heads[then]
                    positions[used, 0] = ax + g[0] * cos + g[1] * sin
                    positions[used, 1] = az + g[1] * cos - g[0] * sin
                    positions[used, 2] = g[2] + aligned
                    heads[then] = used
                    used += 1


class Responsiveness:
    """The same questions to every graph of a database."""

    def __init__(self, database: MotionDatabase, starts: int) -> None:
        self.database = database
        self.horizon = round(HORIZON * database.control_rate)
        rng = np.random.default_rng(7)
        angles = np.arange(8) * math.pi / 4
        self.spots = SPOT_DISTANCE * np.stack([np.sin(angles), np.cos(angles)], axis=-1)
        self.points = np.zeros((0, 3))
        if len(database.strike_frames):
            drawn = rng.choice(len(database.strike_positions), 24)
            self.points = database.strike_positions[drawn] + rng.normal(0.0, 0.1, (24, 3))
        self.first_strikes = np.searchsorted(database.strike_frames, np.arange(database.frame_count) * database.stride)
        self.starts = rng.integers(0, database.frame_count, starts)
        # Room for the bodies of a search; what does not fit is left off, for all graphs alike.
        self.nodes, self.positions = np.empty((4_000_000, 2), np.int64), np.empty((4_000_000, 3))
        self.keys, self.counts = np.empty(1 << 17, np.int64), np.empty(1 << 17, np.int64)

    def ask(self, graph: MotionGraph) -> dict[str, float]:
        """Return the mean seconds and the share reached of `go` and `strike`."""
        database = self.database
        spots = np.empty((len(self.starts), len(self.spots)))
        points = np.empty((len(self.starts), len(self.points)))
        for row, frame in enumerate(self.starts):
            state = min(int(np.searchsorted(graph.state_frames, frame)), graph.state_count - 1)
            search(
                state, self.horizon, graph.action_offsets, graph.action_next, graph.action_first,
                graph.action_lengths, database.ground, database.stride, self.first_strikes, database.strike_frames,
                database.strike_positions.astype(float), self.spots, self.points, self.nodes, self.positions, self.keys,
                self.counts, spots[row], points[row],
            )  # fmt: skip
        rate = database.control_rate
        answer = {"go_seconds": spots.mean() / rate, "go_share": (spots < self.horizon).mean()}
        if points.size:
            answer |= {"strike_seconds": points.mean() / rate, "strike_share": (points < self.horizon).mean()}
        return {name: float(value) for name, value in answer.items()}


def switch_seconds(database: MotionDatabase, graph: MotionGraph, frames: np.ndarray) -> float:
    """Return the mean time of the shortest path from frames (2, N) in row 0 to all in row 1 [s]."""
    kept = graph.frames_kept
    onward = np.flatnonzero(kept[:-1] & kept[1:])
    onward = onward[~np.isin(onward + 1, database.clip_starts)]
    rows, columns = np.r_[onward, graph.transition_from], np.r_[onward + 1, graph.transition_to]
    edges = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(kept), len(kept)))
    return float(dijkstra(edges, unweighted=True, indices=frames[0])[:, frames[1]].mean() / database.control_rate)


def trade_off(database: MotionDatabase, starts: int) -> dict[str, list[dict[str, Any]]]:
    """Return the tables: for each setting the graph's numbers and its responsiveness."""
    questions = Responsiveness(database, starts)
    result: dict[str, list[dict[str, Any]]] = {}
    for table, settings in TABLES.items():
        graphs = []
        for values in settings:
            try:
                graphs.append((values, build_graph(database, GraphSettings(**values))))
            except MotionError as error:
                print(f"{values}: {error}", file=sys.stderr)
        common = np.flatnonzero(np.logical_and.reduce([graph.frames_kept for _, graph in graphs]))
        frames = np.random.default_rng(3).choice(common, (2, 200))
        result[table] = []
        for values, graph in graphs:
            numbers = graph_statistics(graph, database.control_rate)
            row: dict[str, Any] = {**values, "frames_kept": numbers.frames, "states": numbers.states}
            row |= {"actions": numbers.actions, "branching_mean": numbers.branching}
            row |= {"action_seconds": numbers.action_frames / database.control_rate}
            row |= {"cost_mean": numbers.cost_mean, "cost_95": numbers.cost_95}
            row |= {"switch_seconds": switch_seconds(database, graph, frames), **questions.ask(graph)}
            result[table].append(row)
    return result


def performed(seconds: float) -> MotionDatabase:
    """Return a database of the performer."""
    return build_database(measure_clips([performance.clip for performance in perform(seconds, seed=0)]))


def captured(folder: Path, most: int | None = None) -> MotionDatabase:
    """Return a database of the fight clips of real capture, the first few or all, and their mirror images."""
    clips = [to_clip(read_bvh(path), 0.01) for path in sorted((folder / "fight_daz").glob("*.bvh"))[:most]]
    return build_database(measure_clips(clips), mirror=True)


def time_build(seconds: float) -> dict[str, float]:
    """Build graphs of a performance and return the shortest time, the peak memory and the size."""
    build_graph(performed(30.0))
    database = performed(seconds)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    took = []
    for _ in range(3 if seconds < 1000 else 1):
        start, work = time.perf_counter(), time.process_time()
        graph = build_graph(database)
        took.append((time.perf_counter() - start, time.process_time() - work))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "frames": database.frame_count,
        "seconds": min(took)[0],
        "processor_seconds": min(took)[1],
        "peak_megabytes": peak / 1024,
        "peak_megabytes_before": before / 1024,
        "states": graph.state_count,
        "actions": graph.action_count,
        "threads": CORES,
    }


def print_table(rows: list[dict[str, Any]]) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [[f"{row[name]:.3f}" if isinstance(row.get(name), float) else str(row.get(name, "")) for name in names]
             for row in rows]  # fmt: skip
    widths = [max(len(name), *(len(line[place]) for line in cells)) for place, name in enumerate(names)]
    for line in [names, *cells]:
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))
    print()


def main() -> None:
    parser = command_line(__doc__, "seconds: little motion, few starts")
    parser.add_argument("--mocap", default=os.environ.get("CROWDSIM_MOCAP", ""), help="folder with fight_daz")
    parser.add_argument("--child", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        print(json.dumps(time_build(options.child)))
        return
    report: dict[str, Any] = {"speed": [], "trade_off": {}}
    for seconds in (20.0, 30.0) if options.quick else (437.0, 3600.0):
        command = [sys.executable, __file__, "--child", str(seconds)]
        report["speed"].append(json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout))
    starts = 2 if options.quick else 12
    databases = {"performer": performed(40.0 if options.quick else 437.0)}
    if options.mocap and (Path(options.mocap) / "fight_daz").is_dir():
        databases["capture"] = captured(Path(options.mocap), 4 if options.quick else None)
    for name, database in databases.items():
        report["trade_off"][name] = trade_off(database, starts)
    if options.json:
        print(json.dumps(report, indent=1))
        return
    print("speed")
    print_table(report["speed"])
    for name, tables in report["trade_off"].items():
        for table, rows in tables.items():
            print(f"{name}: {table}")
            print_table(rows)


if __name__ == "__main__":
    main()
