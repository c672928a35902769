"""A small crowd to draw."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from crowdsim.crowd.kernels.layout import LANDED
from crowdsim.render.figure import BoneFigure
from crowdsim.render.source import no_strikes

DUMMY = BoneFigure(
    capsule_joints=np.zeros(3, np.int32),
    capsule_starts=np.array([[0.0, -0.85, 0.0], [0.0, 0.75, 0.0], [0.2, 0.4, 0.0]]),
    capsule_ends=np.array([[0.0, 0.4, 0.0], [0.0, 0.75, 0.0], [0.3, 0.3, 0.5]]),
    capsule_radii=np.array([[0.1, 0.16], [0.11, 0.11], [0.05, 0.04]]),
    capsule_parts=np.array([3, 1, 0], np.uint8),
)
"""A body, a head and an arm on a single joint 0.9 m over the floor."""


@dataclass
class Walkers:
    """Dummies that walk along given paths: ground transforms, shape (F, N, 3); a ``PoseSource``."""

    paths: Any
    fps: float = 30.0
    name: str = "walkers"
    teams: Any = None
    strikes: Any = field(default_factory=lambda: np.zeros((0, 4)))
    drawn: list[int] = field(default_factory=list)
    things: Any = None
    arena: Any = field(default_factory=lambda: np.zeros(5))
    cameras: Any = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.frame_count, count = self.paths.shape[:2]
        self.fingerprint = f"{self.paths.tobytes().hex()[:64]}"
        self.avatar_names = tuple(f"walker_{i}" for i in range(count))
        self.avatar_teams = np.arange(count) % 2 if self.teams is None else self.teams
        self.avatar_scales = np.ones(count)
        self.avatar_girths = np.ones(count)
        self.avatar_stretches = np.ones((count, 3))
        self.avatar_heights = np.full(count, 1.8)
        self.avatar_colours = np.full((count, 3), np.nan)
        self.figures = (DUMMY,)
        self.avatar_figures = np.zeros(count, np.int32)

    def ground(self, frames):
        return self.paths[np.asarray(frames)]

    def poses(self, frame, shown=None):
        self.drawn.append(frame)
        x, z, heading = self.paths[frame].T
        positions = np.stack([x, np.full_like(x, 0.95), z], axis=-1)[:, None]
        turns = np.stack([np.cos(heading / 2), 0 * x, np.sin(heading / 2), 0 * x], axis=-1)[:, None]
        return [(positions, turns)]

    def recent_strikes(self, frame):
        if not len(self.strikes):
            return no_strikes()
        ages = frame / self.fps - self.strikes[:, 0]
        now = (ages >= 0) & (ages < 0.4)
        return self.strikes[now, 1:], ages[now], np.full(now.sum(), 8.0), np.full(now.sum(), LANDED)

    def markers(self, frame):
        return np.zeros((0, 3)) if self.things is None else self.things[frame]


def random_walk(frames: int, count: int, seed: int, spread: float = 4.0) -> np.ndarray:
    """Paths of ``count`` walkers who wander at a walking pace. Shape (frames, count, 3)."""
    rng = np.random.default_rng(seed)
    start = rng.normal(size=(count, 2)) * spread
    heading = rng.uniform(-3, 3, count) + np.cumsum(rng.normal(size=(frames, count)) * 0.15, axis=0)
    steps = 0.05 * np.stack([np.sin(heading), np.cos(heading)], axis=-1)
    return np.concatenate([start + np.cumsum(steps, axis=0), heading[..., None]], axis=-1)
