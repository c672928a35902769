"""A classifier tries to distinguish transitions from captured motion, with our blends and with plain ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from _motion.transition_windows import plain_methods
from crowdsim.core.types import Array
from crowdsim.motion.database import MotionDatabase

NOISE = 1e-5
"""Standard deviation of the noise on positions [m]."""
NEAR = 0.05
"""Time around a hard transition that `motions alone` leaves out [s]."""


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
