"""The embedded boxer beside real boxing: movement, the reach of strikes, and the detectors against the truth.

    python benchmarks/performer.py [--json] [--quick] [--seconds 437] [--seed 1] [--capture FILE.bvh]

The capture is CMU's clip 13_18 (shadow boxing) in the folder of CROWDSIM_MOCAP; without it the table has no second
column. Its elbows fold backward in the file and are corrected as for training. Both are measured in the same way at 60
Hz: roles, body and tracks as in training, lengths and speeds scaled to a body of 1.75 m. Percentiles are over all
frames, except where a row says otherwise; rows named "strikes" are the peaks of the striking arm before the hit.

Locomotion: the highest speed of the pelvis over the ground, averaged over half a second of a move alone; the mean
speed from the first foot that leaves the floor to the last that lands; and the contents of the session's clips.

Coverage is over the cells of the paper's punch grid, with heads as targets: a cell is covered where the fist of some
strike, or of its mirror image, ends within 0.1 m of the surface of a head whose middle is the cell's. Targets are
observed at the strike's frame, and, so that steps count, from any frame of the half second before it too.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _fall_detection import count_captured, detect_falls
from _quick import command_line
from scipy.ndimage import uniform_filter1d
from scipy.spatial import KDTree

from crowdsim.capture.loading import load_capture, usable_clips
from crowdsim.core.types import Array
from crowdsim.motion import ground, quaternion
from crowdsim.motion.analysis import on_floor
from crowdsim.motion.body import HEIGHT, Body, build_body
from crowdsim.motion.contacts import find_contacts, runs
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.resampling import resample
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.strikes import find_strikes
from crowdsim.motion.tracks import Tracks, build_tracks, speeds
from crowdsim.performer.session import Performance, perform, perform_solo
from crowdsim.performer.solo import FOOTWORK

FPS = 60.0
BEARINGS = np.linspace(-1.114, 1.317, 11)
DISTANCES = np.linspace(0.297, 1.293, 11)
HEIGHTS = np.linspace(1.266, 1.624, 5)
"""Edges of the cells of the paper's punch grid: bearing [rad], distance and height [m]."""
TOLERANCE = 0.10
BEFORE = 30
"""Frames before a strike from which its target is seen."""
GAITS = tuple(move for move in FOOTWORK if move.startswith("shuffle") or move in ("walk", "jog"))
CLIP = "cmu_13_18_boxing.bvh"
QUANTILES = (5, 25, 50, 75, 95, 99)
CONTROL_FRAME = round(FPS / 15.0)
JOINTS = {
    "pelvis": ("pelvis",),
    "shoulder": ("left_shoulder", "right_shoulder"),
    "elbow": ("left_elbow", "right_elbow"),
    "hip": ("left_hip", "right_hip"),
    "knee": ("left_knee", "right_knee"),
    "head": ("head",),
}
REMARKS = {
    "fist speed [m/s]": "More than twice as many strikes a second; between them the performer keeps its fists stiller.",
    "fist speed, strikes [m/s]": "Held between 5 and 11 m/s, in earnest; the capture strikes at the air, elbows bent.",
    "pelvis speed [m/s]": "A fifth of the performer's session is travel; the capture keeps to its place.",
    "step length [m]": "Strides of walks and jogs, which the capture has not.",
    "pelvis height [height]": "The capture's retargeted figure crouches deeper than a boxer's guard.",
    "trunk lean [rad]": "The performer's guard leans a quarter of a radian; ducks and slips make the tail.",
    "elbow fold [rad]": "Elbows of the capture's figure are bent by 0.3 rad at rest, and its folds come on top.",
    "shoulder speed [rad/s]": "More than twice as many strikes a second as in the capture, out of a folded guard.",
    "elbow speed [rad/s]": "More than twice as many strikes a second; a strike alone: see its row.",
    "shoulder speed, strikes [rad/s]": "Out of a high guard a fist takes a longer path to hooks and uppercuts.",
    "shoulder acceleration [rad/s2]": "As the speed.",
    "elbow acceleration [rad/s2]": "As the speed.",
}


def measure(clip: Clip, body: Body) -> dict[str, Array]:
    """Return samples of every quantity of one clip at ``FPS``, scaled to a body of ``HEIGHT``."""
    size = HEIGHT / body.height
    positions, rotations = clip_kinematics(clip)
    tracks = build_tracks(body, positions, rotations)
    strikes = find_strikes(tracks, body.height, FPS)
    trunk = tracks.necks - tracks.pelvises
    local = quaternion.continuous(clip.rotations)
    turns = quaternion.to_rotation_vector(quaternion.multiply(quaternion.conjugate(local[:-1]), local[1:])) * FPS
    samples = {
        "fist speed [m/s]": speeds(tracks.fists - tracks.pelvises[:, None], FPS).ravel() * size,
        "fist speed, strikes [m/s]": strikes.speeds * size,
        "pelvis speed [m/s]": speeds(tracks.pelvises[:, [0, 2]], FPS) * size,
        "pelvis height [height]": tracks.pelvises[:, 1] / body.height,
        "trunk lean [rad]": np.arccos(np.clip(trunk[:, 1] / np.linalg.norm(trunk, axis=1), -1.0, 1.0)),
        "elbow fold [rad]": np.concatenate([_fold(positions, body, side) for side in ("left", "right")]),
        "step length [m]": _steps(tracks, body) * size,
    }
    for name in ("shoulder", "elbow"):
        arms = [body.roles[f"{side}_{name}"] for side in ("left", "right")]
        swift = [
            np.linalg.norm(turns[max(frame - 14, 0) : frame, arms[hand]], axis=-1).max()
            for frame, hand in zip(strikes.frames, strikes.limbs, strict=True)
        ]
        samples[f"{name} speed, strikes [rad/s]"] = np.array(swift)
    for name, roles in JOINTS.items():
        joints = [body.roles[role] for role in roles]
        samples[f"{name} speed [rad/s]"] = np.linalg.norm(turns[:, joints], axis=-1).ravel()
        bends = np.diff(turns[:, joints], axis=0) * FPS
        samples[f"{name} acceleration [rad/s2]"] = np.linalg.norm(bends, axis=-1).ravel()
    return samples


def _fold(positions: Array, body: Body, side: str) -> Array:
    """Fold of an elbow, 0 when straight [rad]."""
    shoulder, elbow, hand = (positions[:, body.roles[f"{side}_{role}"]] for role in ("shoulder", "elbow", "hand"))
    upper, lower = elbow - shoulder, hand - elbow
    cosine = np.sum(upper * lower, axis=1) / np.linalg.norm(upper, axis=1) / np.linalg.norm(lower, axis=1)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _steps(tracks: Tracks, body: Body) -> Array:
    """Distance of a foot from one contact to the next [m]."""
    contacts = find_contacts(tracks, body.height, FPS)
    lengths = []
    for foot in range(2):
        ball = tracks.balls[:, foot][:, [0, 2]]
        for start, stop in runs(~contacts[:, foot]):
            if start > 0 and stop < len(ball):
                lengths.append(float(np.linalg.norm(ball[stop] - ball[start - 1])))
    return np.array(lengths)


def match_strikes(performance: Performance, body: Body, tracks: Tracks) -> tuple[int, int, int]:
    """Return how many strikes are found rightly, found wrongly, and missed, within one control frame."""
    found = find_strikes(tracks, body.height, FPS)
    free = set(range(len(found.frames)))
    right = 0
    for strike in performance.truth.strikes:
        near = [
            (abs(int(found.frames[k]) - strike.frame), k)
            for k in free
            if found.limbs[k] == strike.hand and abs(int(found.frames[k]) - strike.frame) <= CONTROL_FRAME
        ]
        if near:
            free.remove(min(near)[1])
            right += 1
    return right, len(free), len(performance.truth.strikes) - right


def detect(performances: Sequence[Performance]) -> dict[str, float]:
    """Return how well contacts and strikes are found in performed clips."""
    contacts, strikes = np.zeros(3), np.zeros(3)
    for performance in performances:
        body = build_body(performance.clip.skeleton)
        tracks = build_tracks(body, *clip_kinematics(performance.clip))
        found, true = find_contacts(tracks, body.height, FPS), performance.truth.contacts
        contacts += [(found & true).sum(), (found & ~true).sum(), (~found & true).sum()]
        strikes += match_strikes(performance, body, tracks)
    return {
        "contacts_f1": float(2 * contacts[0] / (2 * contacts[0] + contacts[1] + contacts[2])),
        "strikes": float(strikes[0] + strikes[2]),
        "strike_precision": float(strikes[0] / max(strikes[0] + strikes[1], 1)),
        "strike_recall": float(strikes[0] / max(strikes[0] + strikes[2], 1)),
    }


def cover(performances: Sequence[Performance], body: Body) -> dict[str, Any]:
    """Return the share of cells that strikes cover, and the middles of those that they do not, even before a step."""
    seen, before = [], []
    for performance in performances:
        tracks = build_tracks(body, *clip_kinematics(performance.clip))
        strikes = find_strikes(tracks, body.height, FPS)
        frames = np.maximum(strikes.frames[:, None] - np.arange(0, BEFORE + 1, CONTROL_FRAME), 0)
        fists = tracks.fists[strikes.frames, strikes.limbs]
        places = ground.to_local(tracks.ground[frames], fists[:, None])
        seen.append(places[:, 0])
        before.append(places.reshape(-1, 3))
    middles = [0.5 * (edges[1:] + edges[:-1]) for edges in (BEARINGS, DISTANCES, HEIGHTS)]
    bearing, distance, height = np.meshgrid(*middles, indexing="ij")
    cells = np.stack([distance * np.sin(bearing), height, distance * np.cos(bearing)], axis=-1)
    hit = []
    for ends in (seen, before):
        fists = np.concatenate(ends)
        tree = KDTree(np.concatenate([fists, fists * [-1.0, 1.0, 1.0]]))
        hit.append(tree.query(cells)[0] <= body.head_radius + TOLERANCE)
    missing = np.flatnonzero(~hit[1])
    return {
        "at_the_strike": float(hit[0].mean()),
        "half_a_second_before": float(hit[1].mean()),
        "at_the_strike_by_distance": dict(
            zip(np.round(middles[1], 2).tolist(), hit[0].mean(axis=(0, 2)).tolist(), strict=True)
        ),
        "not_covered": [[round(float(a.flat[i]), 2) for a in (bearing, distance, height)] for i in missing],
    }


def locomote(seeds: Sequence[int]) -> dict[str, dict[str, float]]:
    """Return the highest and the mean speed of every gait and direction [m/s], medians over some seeds."""
    figures = {}
    for move in GAITS:
        top, mean = [], []
        for seed in seeds:
            performance = perform_solo(move, seed, FPS)
            path = performance.clip.root_positions[:, [0, 2]]
            smooth = uniform_filter1d(path, round(0.5 * FPS), axis=0)
            first, last = performance.truth.travels[0].start, performance.truth.travels[-1].end - 1
            top.append(speeds(smooth, FPS).max())
            mean.append(float(np.linalg.norm(path[last] - path[first])) / (last - first) * FPS)
        figures[move] = {"top_speed": float(np.median(top)), "mean_speed": float(np.median(mean))}
    return figures


def share_out(performances: Sequence[Performance]) -> dict[str, float]:
    """Return for how long the clips strike, defend, travel, and do none of that [s]."""
    seconds = dict.fromkeys(("strike", "defence", "shuffle", "walk", "jog", "guard"), 0.0)
    for performance in performances:
        truth = performance.truth
        labels = np.full(performance.clip.frame_count, "guard", dtype="<U8")
        for defence in truth.defences:
            labels[defence.start : defence.end] = "defence"
        for travel in truth.travels:
            labels[travel.start : travel.end] = travel.gait
        for strike in truth.strikes:
            labels[max(round(strike.start * FPS), 0) : round(strike.end * FPS)] = "strike"
        for name, count in zip(*np.unique(labels, return_counts=True), strict=True):
            seconds[str(name)] += float(count) / FPS
    return seconds


def find_capture(given: Path | None) -> Path | None:
    """Return the clip that was given, or the one in the folder of CROWDSIM_MOCAP."""
    if given is not None:
        return given
    folder = os.environ.get("CROWDSIM_MOCAP")
    return next(iter(sorted(Path(folder).rglob(CLIP))), None) if folder else None


def measure_capture(path: Path) -> dict[str, Array]:
    """Return samples of a real clip, without its lead-in and on its floor."""
    capture = load_capture(path)
    usable_clips(capture, strict=False)
    assert capture.body is not None
    clip, _ = on_floor(resample(capture.motion, FPS), capture.body)
    return measure(clip, capture.body)


def summarise(samples: list[dict[str, Array]]) -> dict[str, list[float]]:
    """Return the percentiles of every quantity."""
    return {
        name: np.percentile(np.concatenate([part[name] for part in samples]), QUANTILES).tolist() for name in samples[0]
    }


def main() -> None:
    """Measure and print."""
    parser = command_line(__doc__, "a short session, in seconds")
    parser.add_argument("--seconds", type=float, default=437.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--capture", type=Path)
    options = parser.parse_args()
    if options.quick:
        options.seconds = min(options.seconds, 40.0)
    began = time.perf_counter()
    performances = perform(options.seconds, options.seed, FPS)
    took = time.perf_counter() - began
    body = build_body(performances[0].clip.skeleton)
    performer = summarise([measure(p.clip, body) for p in performances])
    path, folder = find_capture(options.capture), os.environ.get("CROWDSIM_MOCAP")
    capture = summarise([measure_capture(path)]) if path is not None else None
    strikes = sum(len(p.truth.strikes) for p in performances)
    result = {
        "seconds": options.seconds,
        "seed": options.seed,
        "perform_seconds": took,
        "strikes_per_minute": 60.0 * strikes / options.seconds,
        "detectors": detect(performances),
        "falls": {
            "performer": detect_falls(range(1, 2 if options.quick else 21), 10.0 if options.quick else 120.0, FPS),
            "capture": count_captured(Path(folder)) if folder and not options.quick else None,
        },
        "locomotion": locomote(range(1, 2 if options.quick else 6)),
        "seconds_of": share_out(performances),
        "coverage": cover(performances, body),
        "quantiles": list(QUANTILES),
        "performer": performer,
        "capture": capture,
        "remarks": REMARKS,
    }
    if options.json:
        print(json.dumps(result, indent=1))
        return
    print(f"{options.seconds:g} s performed in {took:.1f} s, {result['strikes_per_minute']:.0f} strikes a minute")
    print("detectors: " + ", ".join(f"{name} {value:.3f}" for name, value in result["detectors"].items()))
    for name, found in result["falls"].items():
        if found is not None:
            print(f"falls, {name}: " + ", ".join(f"{key} {value:g}" for key, value in found.items()))
    print("seconds of: " + ", ".join(f"{name} {value:.0f}" for name, value in result["seconds_of"].items()))
    print(f"\n{'':24}{'top':>8}{'mean':>8}  [m/s]")
    for move, figures in result["locomotion"].items():
        print(f"{move:24}{figures['top_speed']:8.2f}{figures['mean_speed']:8.2f}")
    print()
    coverage = result["coverage"]
    by_distance = coverage["at_the_strike_by_distance"]
    print(f"cells covered at the strike {coverage['at_the_strike']:.0%}, from up to half a second before")
    print(f"  {coverage['half_a_second_before']:.0%}; at the strike by distance")
    print("  " + "  ".join(f"{distance:.2f} m {share:.0%}" for distance, share in by_distance.items()))
    print("not covered (bearing, distance, height):")
    for cell in coverage["not_covered"]:
        print("  {:5.2f} rad {:5.2f} m {:5.2f} m".format(*cell))
    print(f"\n{'':32}" + "".join(f"{q:>8}%" for q in QUANTILES))
    for name, values in performer.items():
        print(f"{name:32}" + "".join(f"{value:9.2f}" for value in values))
        if capture is not None:
            print(f"{'  capture':32}" + "".join(f"{value:9.2f}" for value in capture[name]))
            if name in REMARKS:
                print(f"    {REMARKS[name]}")


if __name__ == "__main__":
    main()
