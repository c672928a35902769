"""The cost of control: thirty avatars, a million, and other software for comparison.

    python benchmarks/control.py [--policy NAME] [--crowd-policy NAME] [--threads N] [--json] [--quick]

* brawl_30: 30 avatars in the shipped scene, 1000 control frames, beside the time that scipy's cKDTree alone takes to
  be built and queried for the same positions every frame.
* scale: nanoseconds per avatar and control frame for 10,000, 100,000 and 1,000,000 avatars of two teams, spread out,
  clustered, and as two armies a kilometre apart, with the policy for large crowds; by stage, recording included. They
  ask for no variety and no pauses between bursts, as is the default of ``build_crowd``, not that of scenarios.
* million: a control frame of a million avatars that are spread out, and memory per avatar.
* crowd_1m: a control frame of the shipped scene, whose types pause between bursts and care for variety, beside a
  cKDTree of its avatars that is built and all queried with the same threads; its worst frame over the median, in which
  avatars may be brought into another order; memory per avatar; and a whole run into a folder: what is spent around
  control (take, statistics, checkpoints, preparation, checksums), over control.
* jupedsim: agent-steps per second of its collision-free speed model with 100,000 agents, one thread, beside ours.
* apart: control of ``brawl_30`` and ``armies_200`` with and without collision avoidance.
* reactions: control of ``brawl_30`` with and without reactions to hits.
* decision: one decision (observing and choosing) beside a motion-matching search, cKDTree over the usual 27 features
  of the same motion at the control rate, batched; and at the playback rate, at which motion matching usually searches.

Times are the least of several runs, frame by frame, because machines are shared.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _quick import small_policies, with_policy
from scipy.spatial import cKDTree

from crowdsim.crowd.chunk import STAGES, Chunk
from crowdsim.crowd.crowd import Crowd, build_crowd
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.simulation import Simulation
from crowdsim.motion import ground
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.policy import Policy
from crowdsim.runs.runner import run_to
from crowdsim.scenario.scenario import load_scenario
from crowdsim.training.train import ready_policy

LAYOUTS = ("spread", "clustered", "armies")
COUNTS = {"10k": 10_000, "100k": 100_000, "1m": 1_000_000}
SPACING = 1.5
"""Metres between neighbours, on average."""
QUICK = 1000
"""With ``--quick`` large crowds are so many times smaller; figures keep the names of what they are figures of."""


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def layout(kind: str, count: int, policy: Policy, seed: int = 0) -> Crowd:
    """Return a crowd of two teams that fights by a policy, its avatars at least about half a metre apart."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(count)))
    team = rng.integers(0, 2, count)
    if kind == "clustered":
        # Discs of a thousand at half the spacing, far apart.
        clusters = max(count // 1000, 1)
        across = int(np.ceil(np.sqrt(clusters)))
        cluster = np.arange(count) % clusters
        place = np.arange(count) // clusters
        radius, angle = 0.8 * np.sqrt(place + 0.5) / np.sqrt(np.pi) * 1.1, 2.399963 * place
        x = radius * np.sin(angle) + 120.0 * (cluster % across)
        z = radius * np.cos(angle) + 120.0 * (cluster // across)
    else:
        z, x = np.array(np.divmod(np.arange(count), side)) * SPACING
        x, z = x + rng.uniform(-0.4, 0.4, count), z + rng.uniform(-0.4, 0.4, count)
        if kind == "armies":
            team = (x > x.mean()).astype(int)
            x = x + 1000.0 * team
    order = rng.permutation(count)
    headings = rng.uniform(-np.pi, np.pi, count)
    return build_crowd(x[order], z[order], headings, team=team[order], weights=policy.weights, seed=seed)


def least(run: Callable[[], np.ndarray], times: int) -> np.ndarray:
    """Return the least time of each frame and stage over several equal runs [ns]."""
    return np.min([run() for _ in range(times)], axis=0)


def timed(crowd: Crowd, policy: Policy, frames: int, threads: int, skip: int = 0) -> tuple[np.ndarray, Simulation]:
    """Run a crowd, whatever else would end it; return its timings after ``skip`` frames, and what it is like then."""
    crowd = replace(crowd, policies=[policy], frames=frames + skip, until=None)
    simulation = Simulation(crowd, threads=threads, profiled=True)
    parts: list[np.ndarray] = []
    while simulation.frame < frames + skip:
        timings = simulation.run(1 if crowd.count > 2000 else frames + skip).timings
        assert timings is not None, "a profiled simulation has timings"
        parts.append(timings)
    simulation.close()
    return np.concatenate(parts)[skip:], simulation


def by_stage(timings: np.ndarray, count: int) -> dict[str, float]:
    """Return what each stage costs an avatar-frame [ns]."""
    return dict(zip(STAGES, (timings.mean(axis=0) / count).tolist(), strict=True))


def brawl(policy: Policy, repeats: int, frames: int) -> dict[str, Any]:
    scenario = load_scenario("brawl_30", with_policy(policy.name))
    crowd = draw_crowd(scenario, [policy])
    chunks: list[Chunk] = []
    whole = []
    for _ in range(repeats + 1):
        simulation = Simulation(crowd)
        begun = time.perf_counter()
        chunks.append(simulation.run(frames))
        whole.append(time.perf_counter() - begun)
    timings = least(lambda: timed(crowd, policy, frames, 1)[0], repeats)
    control = timings[:, : len(STAGES) - 1].sum() * 1e-6
    points = np.stack([chunks[0].x, chunks[0].z], axis=-1).astype(float)
    theirs = np.full(frames, np.inf)
    for _ in range(repeats):
        for frame, places in enumerate(points):
            begun = time.perf_counter()
            cKDTree(places, leafsize=32, balanced_tree=False, compact_nodes=False).query(places, k=2)
            theirs[frame] = min(theirs[frame], time.perf_counter() - begun)
    ckdtree = theirs.sum() * 1e3
    decisions = int(simulation.avatars.fight["decisions"].sum())
    return {
        "milliseconds": control,
        "whole_call_milliseconds": min(whole) * 1e3,
        "ckdtree_milliseconds": ckdtree,
        "ratio_to_ckdtree": control / ckdtree,
        "decisions": decisions,
        "decision_nanoseconds": float(timings[:, 1:3].sum()) / decisions,
        "stage_ns": by_stage(timings, crowd.count),
    }


def switched(policy: Policy, name: str, key: str, repeats: int, frames: int) -> dict[str, float]:
    """Return what control of a shipped scenario costs with a key true and false, in turns, and the ratio."""
    crowds = {
        said: draw_crowd(load_scenario(name, [f"{key}={said}", *with_policy(policy.name)]), [policy])
        for said in ("true", "false")
    }
    runs = [{said: timed(crowd, policy, frames, 1)[0] for said, crowd in crowds.items()} for _ in range(repeats)]
    best = {said: np.min([one[said] for one in runs], axis=0) for said in crowds}
    spent = {said: float(timings[:, : len(STAGES) - 1].sum() * 1e-6) for said, timings in best.items()}
    return {
        "milliseconds": spent["true"],
        "milliseconds_without": spent["false"],
        "ratio": spent["true"] / spent["false"],
    }


def scale(policy: Policy, threads: int, quick: bool) -> tuple[dict[str, Any], dict[str, float]]:
    counts = {name: count // QUICK if quick else count for name, count in COUNTS.items()}
    result: dict[str, Any] = {}
    million: dict[str, float] = {}
    for kind in LAYOUTS:
        result[kind] = {}
        for name, count in counts.items():
            crowd = layout(kind, count, policy)
            frames, repeats = (32, 2) if quick or name == "1m" else (32, 5)
            memory = 0.0
            best = np.full((frames, len(STAGES)), np.inf)
            for _ in range(repeats):
                # Sixteen frames on, avatars no longer decide together.
                timings, simulation = timed(crowd, policy, frames, threads, skip=16)
                best = np.minimum(best, timings)
                memory = simulation.nbytes / count
            control = best[:, : len(STAGES) - 1].sum() / frames / count
            result[kind][f"ns_per_avatar_frame_{name}"] = control
            result[kind][f"record_ns_{name}"] = best[:, -1].sum() / frames / count
            result[kind][f"stage_ns_{name}"] = by_stage(best, count)
            stages = ", ".join(f"{stage} {value:.0f}" for stage, value in by_stage(best, count).items())
            say(f"{kind} {name}: {control:.0f} ns an avatar-frame ({stages}), {memory:.0f} bytes an avatar")
            if kind == "spread" and name == "1m":
                million = {
                    "million_frame_milliseconds": control * count * 1e-6,
                    "million_record_milliseconds": best[:, -1].mean() * 1e-6,
                    "million_bytes_per_avatar": memory,
                }
        base = result[kind]["ns_per_avatar_frame_10k"]
        for name in list(counts)[1:]:
            result[kind][f"ratio_{name}_to_10k"] = result[kind][f"ns_per_avatar_frame_{name}"] / base
    return result, million


def shipped(policy: Policy, threads: int, quick: bool) -> dict[str, float]:
    """Return what the shipped scene of a million costs: a control frame, the worst one, memory, a whole run."""
    fraction = 1.0 / QUICK if quick else None
    sets = with_policy(policy.name, "boxer_crowd")
    crowd = draw_crowd(load_scenario("crowd_1m", sets, fraction=fraction), [policy])
    results = [timed(crowd, policy, 24, threads, skip=24) for _ in range(2)]
    timings = np.min([result[0] for result in results], axis=0)
    control = float(timings[:, : len(STAGES) - 1].sum()) / len(timings)
    frames = timings.sum(axis=1)
    simulation = results[-1][1]
    points = np.column_stack([simulation.avatars.x, simulation.avatars.z])
    theirs = np.inf
    for _ in range(2):
        begun = time.perf_counter()
        cKDTree(points, leafsize=32, balanced_tree=False, compact_nodes=False).query(points, k=2, workers=threads)
        theirs = min(theirs, time.perf_counter() - begun)
    return {
        "milliseconds": control * 1e-6,
        "ns_per_avatar_frame": control / crowd.count,
        "ckdtree_milliseconds": theirs * 1e3,
        "ratio_to_ckdtree": control * 1e-9 / theirs,
        "worst_frame_to_median": float(frames.max() / np.median(frames)),
        "bytes_per_avatar": simulation.nbytes / crowd.count,
        **around(sets, fraction, threads),
    }


def around(sets: list[str], fraction: float | None, threads: int) -> dict[str, float]:
    """Return what a whole run of the shipped scene of a million spends on control, and on all around it [s]."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = load_scenario("crowd_1m", sets, fraction=fraction)
        seconds = run_to(Path(folder, "run"), scenario, threads).seconds
    spent = {name: value for name, value in seconds.items() if name not in ("total", "control", "compile")}
    others = sum(spent.values())
    return {
        "run_control_seconds": seconds["control"],
        **{f"run_{name}_seconds": value for name, value in spent.items()},
        "around_to_control": others / seconds["control"],
    }


def jupedsim_rate(count: int, steps: int) -> float:
    """Return agent-steps a second of JuPedSim's collision-free speed model on an open square."""
    import jupedsim as jps

    side = int(np.ceil(np.sqrt(count)))
    width = side * SPACING
    area = [(-20.0, -20.0), (width + 20.0, -20.0), (width + 20.0, width + 20.0), (-20.0, width + 20.0)]
    simulation = jps.Simulation(model=jps.CollisionFreeSpeedModel(), geometry=area)
    goal = simulation.add_waypoint_stage((width / 2, width / 2), 1.0)
    journey = simulation.add_journey(jps.JourneyDescription([goal]))
    z, x = np.divmod(np.arange(count), side)
    for place in zip(x * SPACING, z * SPACING, strict=True):
        simulation.add_agent(
            jps.CollisionFreeSpeedModelAgentParameters(
                journey_id=journey, stage_id=goal, position=(float(place[0]), float(place[1])), radius=0.2
            )
        )
    simulation.iterate(1)
    best = np.inf
    for _ in range(steps):
        begun = time.perf_counter()
        simulation.iterate(1)
        best = min(best, time.perf_counter() - begun)
    return count / best


def jupedsim(policy: Policy, quick: bool) -> dict[str, float]:
    count = 100_000 // QUICK if quick else 100_000
    crowd = layout("spread", count, policy)
    timings = least(lambda: timed(crowd, policy, 16, 1, skip=16)[0], 3)
    ours = count * 16 / (timings[:, : len(STAGES) - 1].sum() * 1e-9)
    theirs = jupedsim_rate(count, 3 if quick else 5)
    return {"agents": count, "ratio_100k": ours / theirs, "agent_steps_per_second": theirs, "ours_per_second": ours}


def features(policy: Policy) -> np.ndarray:
    """Return the usual features of motion matching for each playback frame, each scaled by its spread. Shape (P, 27).

    Places and facings on the ground 20, 40 and 60 frames ahead at 60 Hz; places and velocities of the feet; velocity of
    the hip; all in the frame's ground frame (Clavet 2016; Holden and others 2020).
    """
    database = policy.database
    rate = database.playback_rate
    positions, _ = forward_kinematics(database.skeleton, database.root_positions, database.rotations)
    roles = database.body.roles
    frames = len(positions)
    starts = np.asarray(database.clip_starts) * database.stride
    last = starts[1:][np.searchsorted(starts[1:], np.arange(frames), side="right")] - 1
    columns = []
    for ahead in (20, 40, 60):
        then = database.ground[np.minimum(np.arange(frames) + round(ahead * rate / 60), last)]
        seen = ground.compose(ground.inverse(database.ground), then)
        columns += [seen[:, 0], seen[:, 1], np.sin(seen[:, 2]), np.cos(seen[:, 2])]
    following = np.minimum(np.arange(frames) + 1, last)
    still = database.ground * [0, 0, 1]
    for joint in (roles["left_foot"], roles["right_foot"]):
        columns += list(ground.to_local(database.ground, positions[:, joint]).T)
        columns += list(ground.to_local(still, (positions[following, joint] - positions[:, joint]) * rate).T)
    hip = roles["pelvis"]
    columns += list(ground.to_local(still, (positions[following, hip] - positions[:, hip]) * rate).T)
    outcome = np.stack(columns, axis=-1)
    return np.ascontiguousarray((outcome - outcome.mean(axis=0)) / (outcome.std(axis=0) + 1e-9))


def matching(policy: Policy, decision: float, repeats: int, count: int) -> dict[str, float]:
    rng = np.random.default_rng(0)
    outcome = features(policy)
    result: dict[str, float] = {"decision_nanoseconds": decision}
    for name, rows in (("control", outcome[:: policy.database.stride]), ("playback", outcome)):
        tree = cKDTree(rows)
        queries = rows[rng.integers(len(rows), size=count)] + rng.normal(0, 0.3, (count, rows.shape[1]))
        best = np.inf
        for _ in range(repeats):
            begun = time.perf_counter()
            tree.query(queries)
            best = min(best, time.perf_counter() - begun)
        result[f"search_microseconds_{name}_rate"] = best / len(queries) * 1e6
        result[f"frames_{name}_rate"] = len(rows)
    result["ratio_to_motion_matching"] = result["search_microseconds_control_rate"] * 1e3 / decision
    result["ratio_at_playback_rate"] = result["search_microseconds_playback_rate"] * 1e3 / decision
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--policy", default="boxer", help="of the thirty: a recipe's or bundle's name or path")
    parser.add_argument("--crowd-policy", default="boxer_crowd", help="of all larger crowds")
    parser.add_argument("--mocap", type=Path, help="folder of capture, for a policy that is trained on it")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="print JSON only")
    parser.add_argument("--quick", action="store_true", help="seconds: small crowds, few frames, small policies")
    arguments = parser.parse_args()
    with ExitStack() as stack:
        if arguments.quick:
            stack.enter_context(small_policies())
        found = measure(arguments)
    if arguments.json:
        print(json.dumps(found, indent=2))
    else:
        show(found)


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return all figures."""
    policy = ready_policy(arguments.policy, arguments.mocap, arguments.threads)
    crowd_policy = ready_policy(arguments.crowd_policy, arguments.mocap, arguments.threads)
    repeats, frames = (2, 60) if arguments.quick else (7, 1000)
    say("brawl_30")
    thirty = brawl(policy, repeats, frames)
    say("decision")
    decision = matching(policy, thirty["decision_nanoseconds"], 3, 100 if arguments.quick else 2000)
    say("apart")
    few = 30 if arguments.quick else 300
    keeping = {name: switched(policy, name, "collision_avoidance", repeats, few) for name in ("brawl_30", "armies_200")}
    say("reactions")
    reactions = switched(policy, "brawl_30", "reactions", repeats, frames)
    sizes, million = scale(crowd_policy, arguments.threads, arguments.quick)
    say("crowd_1m")
    scene = shipped(crowd_policy, arguments.threads, arguments.quick)
    say("jupedsim")
    try:
        agents = jupedsim(crowd_policy, arguments.quick)
    except ImportError:
        say("jupedsim is not installed: pip install jupedsim")
        agents = {}
    return {
        "policy": arguments.policy,
        "crowd_policy": arguments.crowd_policy,
        "threads": arguments.threads,
        "brawl_30": thirty,
        "apart": keeping,
        "reactions": reactions,
        "scale": sizes,
        **million,
        "crowd_1m": scene,
        "jupedsim": agents,
        "decision": decision,
    }


def show(found: dict[str, Any]) -> None:
    """Print the figures."""
    thirty, keeping, sizes, agents = (found[name] for name in ("brawl_30", "apart", "scale", "jupedsim"))
    decision = found["decision"]
    print(f"30 avatars x 1000 frames: {thirty['milliseconds']:.1f} ms of control; cKDTree alone", end=" ")
    print(f"{thirty['ckdtree_milliseconds']:.1f} ms; ratio {thirty['ratio_to_ckdtree']:.2f}")
    for name, numbers in keeping.items():
        print(
            f"{name}, 300 frames: {numbers['milliseconds']:.1f} ms, {numbers['milliseconds_without']:.1f} ms", end=" "
        )
        print(f"without collision avoidance; ratio {numbers['ratio']:.2f}")
    reacting = found["reactions"]
    print(f"brawl_30, reactions to hits: {reacting['milliseconds']:.1f} ms", end=", ")
    print(f"{reacting['milliseconds_without']:.1f} ms without; ratio {reacting['ratio']:.2f} (goal 1.1)")
    for kind, numbers in sizes.items():
        costs = " ".join(f"{k.rsplit('_', 1)[1]} {v:.0f} ns" for k, v in numbers.items() if k.startswith("ns_per"))
        ratios = " ".join(f"{v:.2f}" for k, v in numbers.items() if k.startswith("ratio"))
        print(f"{kind:<10} an avatar-frame: {costs}; over 10k: {ratios}")
    print(f"a million avatars: {found['million_frame_milliseconds']:.0f} ms a control frame", end=", ")
    print(f"{found['million_record_milliseconds']:.0f} ms more to record it", end=", ")
    print(f"{found['million_bytes_per_avatar']:.0f} bytes an avatar")
    scene = found["crowd_1m"]
    print(f"crowd_1m: {scene['milliseconds']:.0f} ms a control frame", end="; ")
    print(f"cKDTree, built and all queried: {scene['ckdtree_milliseconds']:.0f} ms", end="; ")
    print(f"ratio {scene['ratio_to_ckdtree']:.2f} (goal 0.09)")
    print(f"  worst frame over the median: {scene['worst_frame_to_median']:.2f} (goal 2)", end="; ")
    print(f"{scene['bytes_per_avatar']:.0f} bytes an avatar (goal 200)")
    stages = ", ".join(f"{name[4:-8]} {value:.1f}" for name, value in scene.items() if name.startswith("run_"))
    print(f"  a run [s]: {stages}; around control, over control: {scene['around_to_control']:.2f} (goal 1)")
    if agents:
        print(f"{agents['agents']} agents, one thread: {agents['ratio_100k']:.1f} times JuPedSim", end="")
        print(f" ({agents['agent_steps_per_second'] / 1e6:.2f} M agent-steps/s)")
    print(f"a decision: {decision['decision_nanoseconds'] / 1e3:.2f} us; motion matching", end=" ")
    print(
        f"{decision['search_microseconds_control_rate']:.0f} us over {decision['frames_control_rate']:.0f} frames",
        end="",
    )
    print(f" (ratio {decision['ratio_to_motion_matching']:.0f}),", end=" ")
    print(f"{decision['search_microseconds_playback_rate']:.0f} us over {decision['frames_playback_rate']:.0f}", end="")
    print(f" (ratio {decision['ratio_at_playback_rate']:.0f})")


if __name__ == "__main__":
    main()
