"""Where strikes land: on a silhouette of the body, from the front and from the side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.layout import BLOCKED, LANDED
from crowdsim.figures import STRIKERS, new_figure
from crowdsim.motion import ground, quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.strikes import HANDS
from crowdsim.poses.contacts import body_points
from crowdsim.poses.outlines import striker_radii
from crowdsim.poses.sampler import PoseSampler

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_MOST = 4000
"""Strikes that are drawn at the most; of more, some evenly picked."""
_LIMBS, _TARGET = "#e4e4e4", "#bdbdbd"


@dataclass(frozen=True)
class Silhouette:
    """A body in a stance, in its own ground frame.

    Attributes:
        starts: One end of each of its capsules [m]. Shape (K, 3).
        ends: The other end [m]. Shape (K, 3).
        radii: Radius at both [m]. Shape (K, 2).
        head: Centre of the head [m]. Shape (3,).
        neck: Upper end of the torso [m]. Shape (3,).
        pelvis: Its lower end [m]. Shape (3,).
        head_radius: Radius of the head [m].
        torso_radius: Radius of the torso [m].
    """

    starts: Array
    ends: Array
    radii: Array
    head: Array
    neck: Array
    pelvis: Array
    head_radius: float
    torso_radius: float


@dataclass(frozen=True)
class Hits:
    """Strikes that landed on avatars: where fists and feet touch, moved from the body that each hit to the silhouette.

    Attributes:
        points: Where, in the silhouette's ground frame [m]. Shape (H, 3).
        on_head: Whether the head was nearer than the torso. Shape (H,).
        limbs: Numbers of ``strikers.LIMBS``. Shape (H,).
        count: Number of strikes that landed in the run; H is less where only some are drawn.
        blocked: Likewise where fists and feet are of strikes that an arm blocked [m]. Shape (B, 3).
    """

    points: Array
    on_head: Array
    limbs: Array
    count: int
    blocked: Array


def build_silhouette(database: MotionDatabase) -> Silhouette:
    """Return the body of a database in the frame of the capture that is nearest to its median stance."""
    features = np.concatenate(
        [np.asarray(database.heads, float), *np.moveaxis(np.asarray(database.fists, float), 1, 0)], 1
    )
    frame = int(np.argmin(np.sum((features - np.median(features, axis=0)) ** 2, axis=1)))
    body: Body = database.body
    one = slice(frame, frame + 1)
    positions, world_rotations = forward_kinematics(
        database.skeleton, database.root_positions[one], database.rotations[one]
    )
    stance = np.asarray(database.ground[frame], float)
    joints = body.capsule_joints

    def posed(offsets: Array) -> Array:
        return ground.to_local(stance, positions[0, joints] + quaternion.rotate(world_rotations[0, joints], offsets))

    head, neck, pelvis, _ = body_points(body, positions, world_rotations, np.ones(1))
    head, neck, pelvis = (ground.to_local(stance, point[0]) for point in (head, neck, pelvis))
    radii = np.asarray(body.capsule_radii, float)
    starts, ends = posed(body.capsule_starts), posed(body.capsule_ends)
    return Silhouette(starts, ends, radii, head, neck, pelvis, body.head_radius, body.torso_radius)


def find_hits(sampler: PoseSampler, silhouette: Silhouette) -> Hits:
    """Return where strikes landed on avatars, or were blocked, on the silhouette."""
    take, events = sampler.take, sampler.take.events
    outcomes, on_avatars = np.asarray(events.outcome), np.asarray(events.victim) >= 0
    landed, blocked = (np.flatnonzero(on_avatars & (outcomes == outcome)) for outcome in (LANDED, BLOCKED))
    some = np.concatenate(
        [
            each[np.unique(np.linspace(0, len(each) - 1, min(len(each), _MOST)).astype(np.int64))]
            for each in (landed, blocked)
        ]
    )
    victims = np.asarray(events.victim)[some].astype(np.int64)
    limbs, frames = np.asarray(events.limb)[some].astype(np.int64), np.asarray(events.frame, dtype=float)[some]
    times, hit, thick = frames / take.control_rate, np.full((len(some), 3), np.nan), np.zeros(len(some))
    attackers = np.asarray(events.attacker)[some].astype(int)
    for which, body, scales, positions, world_rotations in sampler.moments(attackers, times):
        thick[which] = striker_radii(body, limbs[which], scales, take.cast.bare[attackers[which]])
        hit[which] = body_points(body, positions, world_rotations, scales)[3][np.arange(len(which)), limbs[which]]
    rows = np.clip(np.round(frames).astype(np.int64), 0, take.frame_count - 1)
    headings = np.asarray(take.heading[:])[rows, victims].astype(float)
    points, on_head = np.full((len(some), 3), np.nan), np.zeros(len(some), bool)
    for which, body, scales, positions, world_rotations in sampler.moments(victims, times):
        head, neck, pelvis, _ = body_points(body, positions, world_rotations, scales)
        axis = pelvis - neck
        share = np.sum((hit[which] - neck) * axis, axis=1) / np.maximum(np.sum(axis * axis, axis=1), 1e-12)
        share = np.clip(share, 0.0, 1.0)[:, None]
        from_head, from_torso = hit[which] - head, hit[which] - (neck + share * axis)
        gaps = [np.linalg.norm(way, axis=1) for way in (from_head, from_torso)]
        widths = take.cast.widths[victims[which]]
        nearer = gaps[0] - body.head_radius * scales <= gaps[1] - body.torso_radius * widths
        turned = np.zeros((len(which), 3))
        turned[:, 2] = headings[which]
        # What strikes touches with its surface, not with its middle.
        far = np.where(nearer, *gaps)
        touching = np.maximum(1.0 - thick[which] / np.maximum(far, 1e-9), 0.0) / scales
        out = touching[:, None] * ground.to_local(turned, np.where(nearer[:, None], from_head, from_torso))
        middle = silhouette.neck + share * (silhouette.pelvis - silhouette.neck)
        points[which] = np.where(nearer[:, None], silhouette.head, middle) + out
        on_head[which] = nearer
    known = np.isfinite(points).all(axis=1)
    hits, stopped = known & (outcomes[some] == LANDED), known & (outcomes[some] == BLOCKED)
    return Hits(points[hits], on_head[hits], limbs[hits], len(landed), points[stopped])


def hit_figure(sampler: PoseSampler) -> Figure:
    """Draw where strikes land, on a silhouette of the body that most victims have."""
    take = sampler.take
    victims = np.asarray(take.events.victim)[np.asarray(take.events.landed, bool)]
    policies = take.cast.policies[victims[victims >= 0]]
    most = int(np.argmax(np.bincount(policies))) if len(policies) else int(take.cast.policies[0])
    silhouette = build_silhouette(sampler.policies[most].database)
    hits = find_hits(sampler, silhouette)
    figure = new_figure(9.0, 7.0)
    views = figure.subplots(1, 2, sharey=True)
    for axes, across, label in zip(views, (0, 2), ("to its left [m]", "ahead of it [m]"), strict=True):
        _draw_silhouette(axes, silhouette, across)
        size = float(np.clip(3000.0 / max(len(hits.points), 1), 4.0, 30.0))
        for limb, (name, colour) in enumerate(STRIKERS):
            mine = hits.points[hits.limbs == limb]
            if limb not in HANDS and not len(mine):
                continue
            text = f"{name} ({len(mine)})"
            axes.scatter(
                mine[:, across], mine[:, 1], s=size, color=colour, alpha=0.7, linewidths=0, label=text, zorder=3
            )
        stopped = hits.blocked
        if len(stopped):
            text = f"blocked ({len(stopped)})"
            axes.scatter(stopped[:, across], stopped[:, 1], s=size, marker="x", color="0.25", label=text, zorder=3)
        axes.set_xlabel(label)
        axes.set_xlim(-0.75, 0.75)
        axes.set_ylim(0.0, 1.9)
        axes.set_aspect("equal")
    views[0].set_ylabel("height [m]")
    views[0].set_title("from the front", fontsize=10)
    views[1].set_title("from its left side", fontsize=10)
    figure.legend(*views[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    parts = ""
    if len(hits.points):
        share = float(hits.on_head.mean())
        parts = f": {share:.0%} on the head, {1.0 - share:.0%} on the torso"
    figure.suptitle(f"{hits.count} strikes that landed on avatars{parts}")
    return figure


def _draw_silhouette(axes: Axes, silhouette: Silhouette, across: int) -> None:
    """Fill the outlines of limbs, and of head and torso, which strikes can land on, over them."""
    for start, end, radii in zip(silhouette.starts, silhouette.ends, silhouette.radii, strict=True):
        axes.fill(*_outline(start, end, radii, across).T, color=_LIMBS, linewidth=0, zorder=1)
    torso, head = (silhouette.torso_radius,) * 2, (silhouette.head_radius,) * 2
    for start, end, radii in ((silhouette.neck, silhouette.pelvis, torso), (silhouette.head, silhouette.head, head)):
        outline = _outline(start, end, np.array(radii), across)
        axes.fill(*outline.T, facecolor=_TARGET, edgecolor="0.35", linewidth=1.0, alpha=0.8, zorder=2)
    axes.axhline(0.0, color="0.6", lw=0.8)


def _outline(start: Array, end: Array, radii: Array, across: int) -> Array:
    """The outline of a rounded cone as seen along the other level axis. Shape (n, 2)."""
    from scipy.spatial import ConvexHull

    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = np.concatenate([end_[[across, 1]] + r * circle for end_, r in ((start, radii[0]), (end, radii[1]))])
    return np.asarray(points[ConvexHull(points).vertices])
