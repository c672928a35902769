"""Transitions against decisions without one: three classifiers on windows of shown motion, and on the capture behind.

Both are moments at which an avatar chose. Each transition is paired with a decision whose captured motion moves alike
(``matched_moments.py``), so that the two differ by the transition alone; ``unmatched`` are any of both kinds. Features
are velocities, accelerations and jerks of points in the ground frame of the window's middle, and their sizes. Clips are
split in halves: a classifier learns from decisions that leave and enter clips of one half, and is tested on the others.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from _motion.matched_moments import match_moments, speeds_around
from _motion.shown_motion import PARTS, Shown, seen
from crowdsim.core.types import Array

APART = 0.5
"""Time around a decision without a transition in which no other transition lies [s]."""
POINTS = ("pelvis", "chest", "head", "elbow", "hand", "knee", "foot", "ball")
"""Points that classifiers get, by the last word of their names."""
KINDS = ("velocity", "acceleration", "jerk")
WINDOWS = (0.4, 0.8)
"""Lengths of windows [s]."""
SPLITS = 3
MATCHED = 3
"""How many times more transitions are looked at for pairs than are classified."""
LEAST = 30
"""Fewest decisions of either kind that are classified."""


def eligible(shown: Shown, seconds: float) -> tuple[Array, Array]:
    """Return the transitions, and the other decisions, that have captured motion around them for a window.

    No further transition lies in windows of either kind, and none within ``APART`` of other decisions.
    """
    half, frames = round(0.5 * seconds * shown.rate) + 2, shown.positions.shape[1]
    cut = shown.left != shown.entered
    margin = half + round(shown.rate)
    fits = (shown.times >= margin) & (shown.times < frames - margin)
    alone, apart = (_transitions_within(shown, cut, reach) for reach in (half, round(APART * shown.rate)))
    fits &= np.where(cut, alone == 1, apart == 0)
    piece = np.searchsorted(shown.pieces[:, 0], np.arange(len(shown.clips)), side="right") - 1
    for frame in (shown.left - 1, shown.entered):
        low, high = frame - half, frame + half
        fits &= (low >= 0) & (high < len(piece))
        fits &= piece[np.clip(low, 0, len(piece) - 1)] == piece[np.clip(high, 0, len(piece) - 1)]
    return np.flatnonzero(fits & cut), np.flatnonzero(fits & ~cut)


def _transitions_within(shown: Shown, cut: Array, reach: int) -> Array:
    """Return how many transitions lie within so many frames of each decision. Shape (D,)."""
    count, frames = shown.positions.shape[:2]
    marks, times = np.zeros((count, frames + 1), np.int64), shown.times[cut]
    np.add.at(marks, (shown.owners[cut], np.clip(times - reach, 0, frames)), 1)
    np.add.at(marks, (shown.owners[cut], np.clip(times + reach + 1, 0, frames)), -1)
    return np.cumsum(marks, axis=1)[shown.owners, np.minimum(shown.times, frames - 1)]


def select(shown: Shown, seconds: float, most: int, rng: np.random.Generator) -> Array:
    """Return some decisions, as many with a transition as without, and no more than ``most`` of either."""
    kinds = [rng.permutation(kind) for kind in eligible(shown, seconds)]
    count = min(most, *(len(kind) for kind in kinds))
    return np.concatenate([kind[:count] for kind in kinds])


def select_alike(shown: Shown, seconds: float, most: int, rng: np.random.Generator) -> Array:
    """Return decisions with a transition and as many without whose captured motion moves alike."""
    some, others = eligible(shown, seconds)
    some = rng.permutation(some)[: MATCHED * most]
    around = np.arange(round(0.5 * seconds * shown.rate) + 1)
    captured = shown.captured[0]

    def describe(rows: Array) -> Array:
        left, entered = shown.left[rows, None] - 1, shown.entered[rows, None]
        return speeds_around(captured[left - around[::-1]], captured[entered + around], shown.rate)

    one, other = match_moments(describe(some), describe(others))
    return np.concatenate([some[one[:most]], others[other[:most]]])


def windows(shown: Shown, chosen: Array, seconds: float, noise: float) -> tuple[Array, Array]:
    """Return windows of shown motion, and of the capture behind: of a transition one side or the other in turn.

    Noise [m] is added to all positions. Shapes (n, T, P, 3).
    """
    half = round(0.5 * seconds * shown.rate) + 2
    steps, owners, times = np.arange(-half, half + 1), shown.owners[chosen], shown.times[chosen]
    kept = [k for k, name in enumerate(shown.names) if name.split("_")[-1] in POINTS]
    before = np.arange(len(chosen)) % 2 == 1
    frames = np.where(before, shown.left[chosen], shown.entered[chosen])
    own = seen(shown.positions[owners[:, None], times[:, None] + steps][:, :, kept], shown.headings[owners, times])
    behind = seen(shown.captured[0][frames[:, None] + steps][:, :, kept], shown.captured[3][frames])
    rng = np.random.default_rng(0)
    return own + noise * rng.standard_normal(own.shape), behind + noise * rng.standard_normal(behind.shape)


def features(moments: Array, rate: float, kinds: tuple[str, ...] = KINDS, step: int = 1) -> Array:
    """Return derivatives of positions (n, T, P, 3), and their sizes, at every so many frames. Shape (n, D)."""
    parts = []
    for kind in kinds:
        order = KINDS.index(kind) + 1
        # Central differences of velocities, so that they lie on frames.
        change = 0.5 * (moments[:, 2:] - moments[:, :-2]) if order == 1 else np.diff(moments, order, axis=1)
        change = change[:, ::step] * rate**order
        parts += [change.reshape(len(change), -1), np.linalg.norm(change, axis=-1).reshape(len(change), -1)]
    return np.hstack(parts).astype(np.float32)


def _models(seed: int) -> dict[str, Any]:
    from sklearn.ensemble import ExtraTreesClassifier, HistGradientBoostingClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    return {
        "logistic": make_pipeline(StandardScaler(), LogisticRegression(C=1e-3, max_iter=200)),
        "trees": ExtraTreesClassifier(200, min_samples_leaf=2, n_jobs=2, random_state=seed),
        "boosting": HistGradientBoostingClassifier(
            max_iter=40, max_leaf_nodes=8, max_features=0.2, min_samples_leaf=10, max_bins=63, random_state=seed
        ),
    }


def areas(values: Array, labels: Array, clips: Array, names: tuple[str, ...]) -> dict[str, float | None]:
    """Return the mean area under the ROC curve of classifiers, and of the best as ``auc``; None where there are few.

    Args:
        values: Features. Shape (n, D).
        labels: Whether each is a transition. Shape (n,).
        clips: Clips that each leaves and enters. Shape (n, 2).
        names: Names of the classifiers.
    """
    from sklearn.metrics import roc_auc_score

    outcome: dict[str, list[float]] = {name: [] for name in names}
    unique = np.unique(clips)
    for split in range(SPLITS):
        first = np.random.default_rng(split).permutation(unique)[: len(unique) // 2]
        sides = np.isin(clips, first).sum(axis=1)
        train, test = sides == 2, sides == 0
        if min(len(np.unique(labels[train])), len(np.unique(labels[test]))) < 2:
            continue
        for name in names:
            model = _models(split)[name]
            model.fit(values[train], labels[train])
            outcome[name].append(float(roc_auc_score(labels[test], model.predict_proba(values[test])[:, 1])))
    means = {name: float(np.mean(found)) if found else None for name, found in outcome.items()}
    known = [mean for mean in means.values() if mean is not None]
    return {"auc": max(known) if known else None, **means}


def judge_decisions(runs: list[Shown], most: int, noise: float) -> dict[str, Any]:
    """Return how well classifiers distinguish transitions from other decisions of some runs with one policy.

    Returns:
        For each length of windows, ``400_ms`` and ``800_ms``: ``transitions`` and ``others``, how many were
        classified; ``shown`` and ``captured``, areas under the ROC curve of each classifier and of the best, on what
        is shown and on the capture behind it; ``parts`` the same by part of the body and kind of feature, of logistic
        regression and trees, for the shorter windows; ``unmatched``, the same but for ``parts``.
    """
    result: dict[str, Any] = {}
    rng = np.random.default_rng(0)
    for seconds in WINDOWS:
        entry = _judge(runs, [select_alike(shown, seconds, most, rng) for shown in runs], seconds, noise, parts=True)
        any_of_both = [select(shown, seconds, most, rng) for shown in runs]
        entry["unmatched"] = _judge(runs, any_of_both, seconds, noise, parts=False)
        result[f"{round(1000 * seconds)}_ms"] = entry
    return result


def _judge(runs: list[Shown], chosen: list[Array], seconds: float, noise: float, parts: bool) -> dict[str, Any]:
    """Classify the chosen decisions of each run; ``parts`` by part of the body too, where windows are short."""
    some = list(zip(runs, chosen, strict=True))
    labels = np.concatenate([(shown.left != shown.entered)[rows] for shown, rows in some])
    entry: dict[str, Any] = {"transitions": int(labels.sum()), "others": int((~labels).sum())}
    pairs = [windows(shown, rows, seconds, noise) for shown, rows in some]
    clips = np.concatenate(
        [np.stack([s.clips[s.left[rows] - 1], s.clips[s.entered[rows]]], axis=1) for s, rows in some]
    )
    few = min(entry["transitions"], entry["others"]) < LEAST
    points = [name for name in runs[0].names if name.split("_")[-1] in POINTS]
    rate, step = runs[0].rate, round(seconds / WINDOWS[0])
    every: tuple[str, ...] = () if few else ("logistic", "trees", "boosting")
    by_part: dict[str, Any] = {}
    for side, name in enumerate(("shown", "captured")):
        moments = np.concatenate([pair[side] for pair in pairs])
        entry[name] = areas(features(moments, rate, step=step), labels, clips, every)
        for part, words in PARTS.items() if parts and step == 1 else ():
            kept = [k for k, point in enumerate(points) if point.split("_")[-1] in words]
            for kind in KINDS:
                values = features(moments[:, :, kept], rate, (kind,))
                cell = by_part.setdefault(part, {}).setdefault(kind, {})
                cell[name] = areas(values, labels, clips, every[:2])["auc"]
    return {**entry, "parts": by_part} if parts else entry
