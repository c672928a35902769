"""A classifier of exported motion: windows around transitions against windows around decisions without one.

Both are moments at which an avatar chose, so they differ by the transition alone. The capture is split in halves, by
pieces of some seconds; the classifier learns from one half and is tested on the other. ``content`` is the same with
windows of the captured motion, around the frames that transitions leave and enter and around those of the other
moments: what the choice of moments reveals, whatever the blends do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from _exported_run import ExportedRun
from _plain_bvh import Array
from _witness import JOINTS

CLEAR = 0.3
"""Time beyond the window in which no transition lies where none is to be seen [s]."""
PIECE = 5.0
"""Length of the pieces of a clip that go to one half or the other [s]."""
MOST = 1500
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


def classify_transitions(run: ExportedRun, seconds: float) -> dict[str, Any]:
    """Return the area under the ROC curve of the better of two classifiers; 0.5 is guessing.

    Args:
        run: The run.
        seconds: Length of a window [s].
    """
    half = round(0.5 * seconds * run.fps) + 1
    count = len(run.figures[0].head)
    rows: list[tuple[int, int, int, int, bool]] = []
    for avatar, outcome in enumerate(run.decisions):
        times, left, entered = outcome[:, 0], outcome[:, 1].astype(int), outcome[:, 2].astype(int)
        transition = left != entered
        for k, time in enumerate(times):
            frame = round(time * run.fps)
            if not half + run.fps <= frame < count - half - run.fps:
                continue
            near = np.abs(times - time) < 0.5 * seconds + CLEAR
            if transition[k] or not (transition & near).any():
                rows.append((avatar, frame, left[k], entered[k], bool(transition[k])))
    source, step, reach = run.source, run.step, half * run.step
    clip = np.searchsorted(source.starts, np.arange(len(source.clips)), side="right") - 1

    def inside(frame: int) -> bool:
        low, high = frame - reach, frame + reach
        return low >= 0 and high < len(clip) and clip[low] == clip[frame] == clip[high]

    rows = [row for row in rows if inside(row[2] - 1) and inside(row[3])]
    rng = np.random.default_rng(0)
    chosen = []
    for kind in (True, False):
        own = [row for row in rows if row[4] is kind]
        chosen += [own[k] for k in np.sort(rng.permutation(len(own))[:MOST])]
    labels = np.array([row[4] for row in chosen])
    if min(labels.sum(), (~labels).sum()) < 50:
        return {"transitions": int(labels.sum()), "others": int((~labels).sum()), "auc": None, "auc_of_content": None}
    steps = np.arange(-half, half + 1)
    windows = np.stack([run.figures[row[0]].joints[row[1] + steps] / run.scales[row[0]] for row in chosen])
    # Of the capture behind a transition either side is shown in turn.
    frames = np.array([row[2 + k % 2] if row[4] else row[3] for k, row in enumerate(chosen)])
    content = source.figure.joints[frames[:, None] + steps * step]
    # A clip and its mirror image are cut into the same pieces.
    offsets = np.arange(len(clip)) - source.starts[clip]
    piece = source.clips * 10_000 + (offsets / (PIECE * run.sizes.rate)).astype(int)
    clips = np.array([[piece[row[2] - 1], piece[row[3]]] for row in chosen])
    halves = []
    for split in range(SPLITS):
        names = np.unique(piece)
        first = np.random.default_rng(split).permutation(names)[: len(names) // 2]
        sides = np.isin(clips, first).sum(axis=1)
        halves.append(np.where(sides == 2, 1, np.where(sides == 0, 0, -1)))
    return {
        "transitions": int(labels.sum()),
        "others": int((~labels).sum()),
        "auc": _area(_features(windows, run.fps), labels, halves),
        "auc_of_content": _area(_features(content, run.fps), labels, halves),
    }
