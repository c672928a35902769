"""How natural transitions look: a classifier tries to distinguish them from captured motion.

    python benchmarks/motion_quality.py [--mocap DIR] [--json] [--windows 1000] [--seconds 0.4] [--noise 0.01]
                                        [--policy BUNDLE ...] [--brawls 3] [--quick]

Sixty avatars fight, everyone against everyone, with a trained policy. Windows of 0.4 s around their transitions
(`made`) are compared with windows of the capture around the frames that the transitions leave and enter, so the
classes differ by the transition alone. `apart` are those with no other transition near; `every` are drawn evenly from
all transitions of the graph, whether or not an avatar would choose them. Features are velocities and accelerations of
the joints at 60 Hz in the ground frame of the window's middle. Clips are split in halves: a classifier is trained on
transitions and capture of one half and tested on the other. The result is the area under the ROC curve, the mean of
four splits; 0.5 is guessing, 1 is certainty. Two brawls of one policy differ by 0.02 or more, so `made` and `apart`
are means over brawls with different seeds. Of two classifiers, logistic regression and random trees that also get
speeds and magnitudes of accelerations, the better one counts.

`ours` are poses as they are exported, with blends and foot plants, but without the changes that strikes make to arms
and hit reactions make to bodies; `crossfade` mixes both motions over 0.4 s; `hard` does nothing; `motions alone` omits
the moment of a hard transition, so what it shows is the choice of motions, which no blend can change. Noise of 0.01
mm, a tenth of the error of good optical capture, is added to all positions: the performer's planted feet are exactly
still, and without noise a classifier would find rounding errors.

`decisions` are complete poses, with strikes and hit reactions: windows around transitions against windows around
decisions without one, for three classifiers that get jerks too, beside the capture behind these windows. See
`_decisions.py`. `smoothness` is how often joints of complete poses accelerate more than the 99.9th percentile of the
capture, near transitions and near strikes that land, with jumps of joints and drops of the pelvis. See
`_smoothness.py`.

The motion is the embedded performer's
(`policies/boxer.yaml`) and, with --mocap or CROWDSIM_MOCAP, the capture of `policies/boxer_cmu.yaml`; policies that
are not trained are trained first.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from _decisions import KINDS, judge_decisions
from _quick import small_policies
from _shown_motion import PARTS, Shown, read_shown
from _smoothness import measure_smoothness

from crowdsim.core.types import Array
from crowdsim.graph.motion_graph import MotionGraph
from crowdsim.motion import ground, quaternion
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.alignment import align_transitions
from crowdsim.policy.policy import Policy
from crowdsim.policy.rewards import target_body
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.poses import PoseSampler
from crowdsim.take.take import Cast, Events, Take
from crowdsim.training.train import ready_policy

APART = 0.5
"""Time within which no other transition lies where one counts as apart [s]."""
NOISE = 1e-5
"""Standard deviation of the noise on positions [m]."""
NEAR = 0.05
"""Time around a hard transition that `motions alone` leaves out [s]."""
FADE = 12
"""Playback frames of a cross-fade on either side of the transition."""
ROWS = 15
"""Control frames of motion before and after a transition."""
SCENE = ["groups.0.count=60", "types.boxer.scale=1", "groups.0.placement.radius=7", "fps=60", "duration=1000"]
QUICK = ["groups.0.count=12", "groups.0.placement.radius=3", "duration=200"]
"""What is other in a quick brawl."""


def inside(database: MotionDatabase, frames: Array, rows: int) -> Array:
    """Whether control frames have captured motion around them."""
    starts = np.asarray(database.clip_starts)
    clip = np.searchsorted(starts, frames, side="right") - 1
    return np.asarray((frames - rows - 1 >= starts[clip]) & (frames + rows + 1 < starts[clip + 1]))


def usable(database: MotionDatabase, graph: MotionGraph, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return control frames before and after some transitions that have motion around them: left, and landed on."""
    leave, enter = np.asarray(graph.transition_from), np.asarray(graph.transition_to) - 1
    fits = np.flatnonzero(inside(database, leave, ROWS) & inside(database, enter, ROWS))
    fits = rng.permutation(fits)[:count]
    return leave[fits], enter[fits]


def fight(policy: Policy, seed: int = 0, quick: bool = False) -> Take:
    """Sixty fight by a policy."""
    scenario = load_scenario("brawl_30", [*SCENE, *(QUICK if quick else []), f"seed={seed}"])
    return run(scenario, [policy], threads=2)


def without_strikes(take: Take, policy: Policy) -> PoseSampler:
    """Poses of a take without what strikes do."""
    none = Events(*(getattr(take.events, name)[:0] for name in Events.__dataclass_fields__))
    return PoseSampler(replace(take, events=none), [policy], threads=2)


def made(sampler: PoseSampler, half: int, most: int, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """Control frames left and entered by transitions, joint positions around them (n, T, roles, 3), which are apart."""
    database, take = sampler.policies[0].database, sampler.take
    rate, stride = database.playback_rate, database.stride
    numbers = np.arange(take.avatar_count)
    window = sampler.window(0, numbers, np.array([0.0, take.seconds]))
    transitions = window.transitions()
    leave, enter, centre = (
        transitions.before // stride,
        transitions.after // stride,
        np.round(transitions.times * rate).astype(int),
    )
    reach, last = half + 1, take.output_frames(rate) - 1
    rows = -(-reach // stride)
    fits = inside(database, leave, rows) & inside(database, enter, rows)
    fits &= (centre >= rate) & (centre < last - rate)
    gaps = np.where(transitions.owners[1:] == transitions.owners[:-1], np.diff(transitions.times), np.inf)
    apart = np.minimum(np.concatenate([[np.inf], gaps]), np.concatenate([gaps, [np.inf]])) > APART
    chosen = np.sort(rng.permutation(np.flatnonzero(fits))[:most])
    positions = []
    for transition in chosen:
        poses = sampler.sample(
            centre[transition] - reach, centre[transition] + reach + 1, rate, numbers[[transitions.owners[transition]]]
        )[0]
        base = transitions.ground[transition]
        rotations = np.array(poses.rotations[:, 0], dtype=float)
        rotations[:, 0] = quaternion.multiply(quaternion.about_y(-base[2]), rotations[:, 0])
        roots = ground.to_local(base, np.asarray(poses.root_positions[:, 0], dtype=float))
        positions.append(joints(database, roots[None], rotations[None])[0])
    return leave[chosen], enter[chosen], np.stack(positions), apart[chosen]


def take_of_transitions(database: MotionDatabase, leave: Array, enter: Array) -> PoseSampler:
    """A take in which every avatar shows one transition, in the middle, standing on the origin."""
    count, stride = len(leave), database.stride
    steps = np.arange(-ROWS, ROWS + 1)
    past = steps[:, None] >= 0
    frames = np.where(past, enter + steps[:, None], leave + steps[:, None])
    middle = np.where(past, enter, leave)
    place = ground.compose(ground.inverse(database.ground[middle * stride]), database.ground[frames * stride])
    numbers = np.arange(count)
    shifts = np.zeros((2 * count, 3))
    shifts[1::2] = align_transitions(database, leave * stride, enter * stride).shifts
    place = np.where(past[..., None], ground.compose(shifts[1::2], place), place)
    action = np.where(past, 2 * numbers + 1, 2 * numbers)
    phase = np.where(past, steps[:, None], steps[:, None] + ROWS)
    shape = (2 * ROWS + 1, count)
    first = np.stack([leave - ROWS + 1, enter + 1], axis=1).ravel()
    graph = SimpleNamespace(action_first=first, action_lengths=np.full(2 * count, ROWS))
    zeros = np.zeros(count, np.int16)
    cast = Cast(numbers.astype(str), zeros, zeros, zeros, np.ones(count, np.float32), np.ones(count, np.float32),
                ("boxer",), ("all",), ("motion",), np.full((1, 3), np.nan))  # fmt: skip
    events = Events(*(np.zeros((0, 3) if name == "point" else 0) for name in Events.__dataclass_fields__))
    x, z, heading = (place[..., k].astype(np.float32) for k in range(3))
    take = Take(
        action=np.broadcast_to(action, shape).astype(np.int32),
        action_frame=np.broadcast_to(phase, shape).astype(np.float32),
        x=x,
        z=z,
        heading=heading,
        opponent=np.full(shape, -1, np.int32),
        cast=cast,
        targets=np.zeros((shape[0], 0, 3)),
        target_names=(),
        events=events,
        control_rate=database.control_rate,
        scenario="transitions",
        seed=0,
        fingerprints=("",),
        status="done",
    )
    actions = SimpleNamespace(shifts=shifts)
    body = target_body(database)
    policy: Any = SimpleNamespace(database=database, graph=graph, actions=actions, fingerprint="", body=body)
    return PoseSampler(take, [policy], threads=2)


def played(database: MotionDatabase, middle: Array, reach: int) -> tuple[Array, Array]:
    """Captured motion around frames in their ground frame: positions of roots (n, T, 3) and rotations (n, T, J, 4)."""
    frames = middle[:, None] * database.stride + np.arange(-reach, reach + 1)
    origin = database.ground[middle * database.stride][:, None]
    roots = ground.to_local(origin, database.root_positions[frames])
    rotations = np.array(database.rotations[frames], dtype=float)
    rotations[:, :, 0] = quaternion.multiply(quaternion.about_y(-origin[..., 2]), rotations[:, :, 0])
    return roots, rotations


def joints(database: MotionDatabase, roots: Array, rotations: Array) -> Array:
    """Positions of the joints that have roles (n, T, roles, 3)."""
    count, times = roots.shape[:2]
    flat = rotations.reshape(count * times, -1, 4).astype(np.float32)
    positions, _ = forward_kinematics(database.skeleton, roots.reshape(-1, 3), flat, threads=1)
    kept = sorted(set(database.body.roles.values()))
    return positions[:, kept].reshape(count, times, len(kept), 3).astype(float)


def plain_methods(database: MotionDatabase, leave: Array, enter: Array, half: int) -> dict[str, Array]:
    """Joint positions over windows of plain methods of transition, and of the capture. Shape (n, T, roles, 3)."""
    reach = half + 1
    before, after = played(database, leave, reach), played(database, enter, reach)
    steps = np.arange(-reach, reach + 1)
    hard = [
        np.where((steps >= 0).reshape(1, -1, *[1] * (a.ndim - 2)), b, a) for a, b in zip(before, after, strict=True)
    ]
    share = np.clip((steps + FADE) / (2 * FADE), 0.0, 1.0)
    share = (share * share * (3.0 - 2.0 * share)).reshape(1, -1, 1)
    sign = np.where(np.sum(before[1] * after[1], axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    mixed = before[1] * (1.0 - share[..., None]) + sign * after[1] * share[..., None]
    faded = [before[0] * (1.0 - share) + after[0] * share, quaternion.normalise(mixed)]
    return {
        "crossfade": joints(database, *faded),
        "hard": joints(database, *hard),
        "left": joints(database, *before),
        "entered": joints(database, *after),
    }


def alone(database: MotionDatabase, leave: Array, enter: Array, half: int) -> Array:
    """Joint positions around transitions that are made one at a time. Shape (n, T, roles, 3)."""
    sampler, reach, centre = take_of_transitions(database, leave, enter), half + 1, ROWS * database.stride
    poses = sampler.sample(centre - reach, centre + reach + 1, database.playback_rate)[0]
    return joints(database, poses.root_positions.swapaxes(0, 1), poses.rotations.swapaxes(0, 1))


def features(positions: Array, rate: float, leave_out: float) -> tuple[Array, Array]:
    """Velocities and accelerations of windows (n, ...), and their sizes alone, but in the middle."""
    velocity = (positions[:, 2:] - positions[:, :-2]) * (0.5 * rate)
    acceleration = (positions[:, 2:] - 2.0 * positions[:, 1:-1] + positions[:, :-2]) * (rate * rate)
    both = np.stack([velocity, acceleration], axis=2)[:, ::2]
    steps = np.arange(both.shape[1]) * 2 - velocity.shape[1] // 2
    both = both[:, np.abs(steps) >= leave_out * rate - 1e-6]
    sizes = np.linalg.norm(both, axis=-1)
    return both.reshape(len(both), -1).astype(np.float32), sizes.reshape(len(sizes), -1).astype(np.float32)


def areas(
    database: MotionDatabase, transitions: dict[str, Array], leave: Array, enter: Array, kind: str
) -> dict[str, float]:
    """Mean area under the ROC curve of each classifier, trained and asked on different clips."""
    from sklearn.ensemble import ExtraTreesClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.metrics import roc_auc_score
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    rate = database.playback_rate
    # A clip and its mirror image lie in the same half.
    names = [name.removesuffix("~mirror") for name in database.clip_names]
    unique = sorted(set(names))
    clip_of = np.array([unique.index(name) for name in names])
    starts = np.asarray(database.clip_starts)
    left, entered = (clip_of[np.searchsorted(starts, frames, side="right") - 1] for frames in (leave, enter))
    bare = kind == "motions alone"
    shown = transitions["hard" if bare else kind]
    pairs = {
        key: features(positions, rate, NEAR if bare else 0.0)
        for key, positions in ((kind, shown), ("left", transitions["left"]), ("entered", transitions["entered"]))
    }
    half = np.arange(len(leave)) % 2 == 0
    outcome: dict[str, list[float]] = {"logistic": [], "trees": []}
    for split in range(4):
        chosen = np.random.default_rng(split).permutation(len(unique))[: len(unique) // 2]
        sides = np.isin(left, chosen).astype(int) + np.isin(entered, chosen)
        parts = []
        for side in (2, 0):
            within = sides == side
            rows = [pairs[kind], *(tuple(f for f in pairs[key]) for key in ("left", "entered"))]
            masks = [within, within & half, within & ~half]
            parts.append(
                (
                    *tuple(
                        np.concatenate([row[k][mask] for row, mask in zip(rows, masks, strict=True)]) for k in (0, 1)
                    ),
                    np.concatenate([np.ones(within.sum()), np.zeros(within.sum())]),
                )
            )
        (train, train_sizes, labels), (test, test_sizes, truth) = parts
        if min(len(np.unique(labels)), len(np.unique(truth))) < 2:
            continue
        trees = ExtraTreesClassifier(300, min_samples_leaf=2, n_jobs=2, random_state=split)
        models: dict[str, tuple[Any, Array, Array]] = {
            "logistic": (make_pipeline(StandardScaler(), LogisticRegression(C=1e-3, max_iter=200)), train, test),
            "trees": (trees, np.hstack([train, train_sizes]), np.hstack([test, test_sizes])),
        }
        for name, (model, known, asked) in models.items():
            model.fit(known, labels)
            outcome[name].append(float(roc_auc_score(truth, model.predict_proba(asked)[:, 1])))
    return {name: float(np.mean(values)) if values else float("nan") for name, values in outcome.items()}


def judge(
    database: MotionDatabase,
    leave: Array,
    enter: Array,
    ours: Array,
    kinds: tuple[str, ...] = ("crossfade", "hard", "motions alone"),
    noise: float = NOISE,
) -> dict[str, Any]:
    """How well classifiers distinguish transitions from captured motion, with our blends and with plain ones."""
    transitions = {**plain_methods(database, leave, enter, ours.shape[1] // 2 - 1), "ours": ours}
    rng = np.random.default_rng(0)
    transitions = {
        key: positions + noise * rng.standard_normal(positions.shape) for key, positions in transitions.items()
    }
    outcome: dict[str, Any] = {
        "transitions": len(leave),
        "of_them_different": len(np.unique(np.stack([leave, enter]), axis=1).T),
    }
    for kind in ("ours", *kinds):
        by = areas(database, transitions, leave, enter, kind)
        outcome[kind] = {"auc": max(by.values()), **by}
    return outcome


def mean_of(outcome: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the means of like tables of numbers."""
    first = outcome[0]
    return {
        key: mean_of([one[key] for one in outcome])
        if isinstance(value, dict)
        else float(np.mean([one[key] for one in outcome]))
        for key, value in first.items()
    }


def _plain(outcome: Any) -> Any:
    """Return plain data with null for what is no number: too few transitions."""
    if isinstance(outcome, dict):
        return {key: _plain(value) for key, value in outcome.items()}
    if isinstance(outcome, list):
        return [_plain(value) for value in outcome]
    return None if isinstance(outcome, float) and not np.isfinite(outcome) else outcome


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of each policy."""
    result: dict[str, Any] = {}
    noise = 1e-3 * options.noise
    for name in options.policy or ["boxer", *(["boxer_cmu"] if options.mocap else [])]:
        print(f"{name} ...", file=sys.stderr, flush=True)
        policy = ready_policy(name, options.mocap, threads=2)
        database = policy.database
        half = round(0.5 * options.seconds * database.playback_rate)
        brawls: list[dict[str, Any]] = []
        runs: list[Shown] = []
        smooth: list[dict[str, Any]] = []
        for seed in range(options.brawls):
            take = fight(policy, seed, options.quick)
            shown_run = read_shown(PoseSampler(take, [policy], threads=2))
            smooth.append(measure_smoothness(shown_run))
            runs.append(replace(shown_run, rotations=np.empty(0), local=np.empty(0)))
            sampler = without_strikes(take, policy)
            leave, enter, shown, apart = made(sampler, half, options.windows, np.random.default_rng(seed))
            fighters, seconds = sampler.take.avatar_count, sampler.take.seconds
            transitions = sampler.window(0, np.arange(fighters), np.array([0.0, seconds])).transitions()
            brawls.append(
                {
                    "transitions_per_second": len(transitions.times) / (fighters * seconds),
                    "made": judge(database, leave, enter, shown, noise=noise),
                    "apart": judge(database, leave[apart], enter[apart], shown[apart], noise=noise),
                }
            )
        every = usable(database, policy.graph, options.windows, np.random.default_rng(0))
        result[Path(name).name] = {
            **mean_of(brawls),
            "decisions": judge_decisions(runs, options.windows, noise),
            "smoothness": mean_of(smooth),
            "made_in_each": [brawl["made"]["ours"]["auc"] for brawl in brawls],
            "every": judge(database, *every, alone(database, *every, half), noise=noise),
        }
    return result


def _shown_and_captured(pair: dict[str, Any]) -> str:
    """Return two figures side by side, the second in brackets."""
    own, theirs = (pair[name]["auc"] if isinstance(pair[name], dict) else pair[name] for name in ("shown", "captured"))
    return "      -      " if own is None or theirs is None else f"{own:6.3f} ({theirs:5.3f})"


def _print_decisions(outcome: dict[str, Any]) -> None:
    print("  AUC of transitions against other decisions, and (of the capture behind them)")
    for length, entry in outcome.items():
        best = _shown_and_captured(entry)
        each = ", ".join(
            f"{name} {_shown_and_captured({side: entry[side][name] for side in ('shown', 'captured')})}"
            for name in entry["shown"]
            if name != "auc"
        )
        print(f"    {length}, {entry['transitions']} and {entry['others']}: {best}; {each}")
        for part, kinds in entry["parts"].items():
            print(f"      {part:8}", "  ".join(f"{kind} {_shown_and_captured(kinds[kind])}" for kind in KINDS))


def _print_smoothness(outcome: dict[str, Any]) -> None:
    print("  frames above the 99.9th percentile of the capture [per mille], and (of the capture behind them)")
    for group in ("near_transitions", "near_strikes", "elsewhere"):
        for part in PARTS:
            kinds = outcome[group][part]
            cells = "  ".join(f"{kind} {_shown_and_captured(pair)}" for kind, pair in kinds.items())
            print(f"    {group:17} {part:6} {cells}")
    for name in ("jumps_per_minute", "pelvis_drops_per_minute"):
        print(f"    {name}: {_shown_and_captured(outcome[name])}")


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mocap", type=Path, default=os.environ.get("CROWDSIM_MOCAP"), help="folder with capture")
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    parser.add_argument("--windows", type=int, default=1000, help="most transitions that are classified")
    parser.add_argument("--policy", nargs="+", help="recipes or bundles other than boxer and boxer_cmu")
    parser.add_argument("--seconds", type=float, default=0.4, help="length of a window, 0.2 to 1.6")
    parser.add_argument("--brawls", type=int, default=3, help="brawls whose transitions are classified")
    parser.add_argument("--noise", type=float, default=1e3 * NOISE, help="noise on all positions [mm]")
    parser.add_argument("--quick", action="store_true", help="seconds: one small brawl, small policies")
    options = parser.parse_args()
    if options.quick:
        options.windows, options.brawls = min(options.windows, 80), 1
    if options.noise < 0.0:
        parser.error(f"--noise is {options.noise}, expected 0 or more")
    if not 0.2 <= options.seconds <= 1.6:
        parser.error(f"--seconds is {options.seconds}, expected 0.2 to 1.6")
    if options.brawls < 1:
        parser.error(f"--brawls is {options.brawls}, expected 1 or more")
    with ExitStack() as stack:
        if options.quick:
            # Two clips, so that classifiers can be asked about what they have not seen.
            stack.enter_context(small_policies(60.0))
        result = measure(options)
    if options.json:
        print(json.dumps(_plain(result), indent=2, allow_nan=False))
        return
    for name, outcome in result.items():
        each = ", ".join(f"{area:.3f}" for area in outcome["made_in_each"])
        rate = outcome["transitions_per_second"]
        print(f"{name}: {rate:.2f} transitions per avatar per second; AUC of ours in each brawl: {each}")
        for group in ("made", "apart", "every"):
            rows = outcome[group]
            print(f"  {group} ({rows['transitions']:.0f} transitions, {rows['of_them_different']:.0f} different)")
            print(f"    {'':24} {'AUC':>7} {'logistic':>8} {'trees':>6}")
            for kind in ("ours", "crossfade", "hard", "motions alone"):
                row = rows[kind]
                print(f"    {kind:24} {row['auc']:7.3f} {row['logistic']:8.3f} {row['trees']:6.3f}")
        _print_decisions(outcome["decisions"])
        _print_smoothness(outcome["smoothness"])


if __name__ == "__main__":
    main()
