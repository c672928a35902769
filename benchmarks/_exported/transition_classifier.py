"""A classifier of exported motion: windows around transitions against windows around decisions without one.

Both are moments at which an avatar chose. The capture is split in halves, by pieces of some seconds; the classifier
learns from one half and is tested on the other. ``content`` is the same with windows of the captured motion, around the
frames that transitions leave and enter and around those of the other moments: what the choice of moments reveals,
whatever the blends do. ``matched`` are pairs of both kinds whose captured motion moves alike (``matched_moments.py``),
which differ by the transition alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from _motion.matched_moments import match_moments, speeds_around

from _exported.plain_bvh import Array
from _exported.run import ExportedRun
from _exported.witness import JOINTS

CLEAR = 0.3
"""Time beyond the window in which no transition lies where none is to be seen [s]."""
PIECE = 5.0
"""Length of the pieces of a clip that go to one half or the other [s]."""
MOST = 1500
LEAST = 50
"""Fewest moments of either kind that are classified."""
SPLITS = 4


def _features(windows: Array, fps: float) -> Array:
    """Velocities and accelerations (n, ...) of windows (n, T, J, 3) as seen from their middle, and their sizes."""
    hips = windows[:, windows.shape[1] // 2, JOINTS.index("left_hip")]
    across = hips - windows[:, windows.shape[1] // 2, JOINTS.index("right_hip")]
    angle = np.arctan2(across[:, 2], across[:, 0])
    cos, sin = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    x, z = windows[..., 0] * cos + windows[..., 2] * sin, windows[..., 2] * cos - windows[..., 0] * sin
    seen = np.stack([x, windows[..., 1], z], axis=-1)
    velocity = (seen[:, 2:] - seen[:, :-2]) * (0.5 * fps)
    acceleration = (seen[:, 2:] - 2.0 * seen[:, 1:-1] + seen[:, :-2]) * fps**2
    both = np.stack([velocity, acceleration], axis=2)
    sizes = np.linalg.norm(both, axis=-1)
    return np.hstack([both.reshape(len(both), -1), sizes.reshape(len(sizes), -1)]).astype(np.float32)


def _area(features: Array, labels: Array, halves: list[Array]) -> float | None:
    from sklearn.ensemble import ExtraTreesClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.metrics import roc_auc_score
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    outcome: list[tuple[float, float]] = []
    for split, half in enumerate(halves):
        train, test = half == 1, half == 0
        if min(len(np.unique(labels[train])), len(np.unique(labels[test]))) < 2:
            continue
        models = (
            make_pipeline(StandardScaler(), LogisticRegression(C=1e-3, max_iter=200)),
            ExtraTreesClassifier(200, min_samples_leaf=2, random_state=split, n_jobs=1),
        )
        areas = []
        for model in models:
            model.fit(features[train], labels[train])
            areas.append(float(roc_auc_score(labels[test], model.predict_proba(features[test])[:, 1])))
        outcome.append((areas[0], areas[1]))
    return float(np.mean(outcome, axis=0).max()) if outcome else None


def _moments(run: ExportedRun, half: int, seconds: float) -> Array:
    """Return avatar, frame, frames of the source left and entered, and whether it is a transition, of each decision.

    Others with a transition near are left out, and those without captured motion around. Shape (n, 6); the last column
    says whether no further transition is in the window.
    """
    count, rows = run.count, []
    for avatar, outcome in enumerate(run.decisions):
        times, left, entered = outcome[:, 0], outcome[:, 1].astype(int), outcome[:, 2].astype(int)
        transition = left != entered
        for k, time in enumerate(times):
            frame = round(time * run.fps)
            if not half + run.fps <= frame < count - half - run.fps:
                continue
            apart = np.abs(times - time)
            if transition[k] or not transition[apart < 0.5 * seconds + CLEAR].any():
                alone = np.count_nonzero(transition[apart * run.fps <= half]) <= 1
                rows.append((avatar, frame, left[k], entered[k], transition[k], alone))
    found = np.array(rows, dtype=int).reshape(-1, 6)
    source, reach = run.source, half * run.step
    clip = np.searchsorted(source.starts, np.arange(len(source.clips)), side="right") - 1
    inside = np.ones(len(found), bool)
    for frames in (found[:, 2] - 1, found[:, 3]):
        low, high = frames - reach, frames + reach
        inside &= (low >= 0) & (high < len(clip))
        ends = (np.clip(one, 0, len(clip) - 1) for one in (low, frames, high))
        first, middle, last = (clip[one] for one in ends)
        inside &= (first == middle) & (middle == last)
    return found[inside]


def classify_transitions(run: ExportedRun, seconds: float) -> dict[str, Any]:
    """Return the area under the ROC curve of the better of two classifiers; 0.5 is guessing.

    Args:
        run: The run.
        seconds: Length of a window [s].
    """
    half = round(0.5 * seconds * run.fps) + 1
    rows = _moments(run, half, seconds)
    rng = np.random.default_rng(0)
    kinds = [rows[rows[:, 4] == kind] for kind in (1, 0)]
    chosen = np.concatenate([own[np.sort(rng.permutation(len(own))[:MOST])] for own in kinds])
    return {**_classify(run, chosen, half), "matched": _classify(run, _matched(run, kinds, half, rng), half)}


def _matched(run: ExportedRun, kinds: list[Array], half: int, rng: np.random.Generator) -> Array:
    """Return transitions without others in their windows, and as many other moments whose captured motion is alike."""
    joints, around = run.source.figure.joints, np.arange(half + 1) * run.step
    some = kinds[0][kinds[0][:, 5] == 1]
    some = some[np.sort(rng.permutation(len(some))[: 2 * MOST])]
    one, other = match_moments(
        *(
            speeds_around(joints[rows[:, 2, None] - 1 - around[::-1]], joints[rows[:, 3, None] + around], run.fps)
            for rows in (some, kinds[1])
        )
    )
    return np.concatenate([some[one], kinds[1][other]])


def _classify(run: ExportedRun, chosen: Array, half: int) -> dict[str, Any]:
    """Return how well some moments (n, 6) are classified by shown motion, and by the source behind it."""
    labels, source = chosen[:, 4] == 1, run.source
    outcome = {"transitions": int(labels.sum()), "others": int((~labels).sum())}
    if min(outcome.values()) < LEAST:
        return {**outcome, "auc": None, "auc_of_content": None}
    steps = np.arange(-half, half + 1)
    windows = np.stack([run.figures[n].joints[frame + steps] / run.scales[n] for n, frame in chosen[:, :2]])
    # Of the capture behind a transition either side is shown in turn.
    entered = (np.arange(len(chosen)) % 2 == 1) | ~labels
    frames = np.where(entered, chosen[:, 3], chosen[:, 2])
    content = source.figure.joints[frames[:, None] + steps * run.step]
    # A clip and its mirror image are cut into the same pieces.
    clip = np.searchsorted(source.starts, np.arange(len(source.clips)), side="right") - 1
    offsets = np.arange(len(clip)) - source.starts[clip]
    piece = source.clips * 10_000 + (offsets / (PIECE * run.sizes.rate)).astype(int)
    clips = np.stack([piece[chosen[:, 2] - 1], piece[chosen[:, 3]]], axis=1)
    halves, names = [], np.unique(piece)
    for split in range(SPLITS):
        first = np.random.default_rng(split).permutation(names)[: len(names) // 2]
        sides = np.isin(clips, first).sum(axis=1)
        halves.append(np.where(sides == 2, 1, np.where(sides == 0, 0, -1)))
    return {
        **outcome,
        "auc": _area(_features(windows, run.fps), labels, halves),
        "auc_of_content": _area(_features(content, run.fps), labels, halves),
    }
