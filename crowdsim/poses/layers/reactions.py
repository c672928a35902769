"""Hits show: a blow to the head throws it back, one to the body folds the trunk, both push the pelvis.

How far goes with the blow's impulse; a blow besides turns head or trunk aside that comes from beside their middle. All
spring back, over the motion. A strike that is blocked moves them a third as far, and the arm that stops it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.crowd.cast import Cast
from crowdsim.crowd.kernels.resolve import FOOT, GUARDED
from crowdsim.motion.strikers import LEGS, LIMBS
from crowdsim.poses.contacts import PoseAt, body_points, surface_point
from crowdsim.poses.down_state import falls_soon
from crowdsim.poses.hits import Landed, by_column
from crowdsim.poses.kernels.columns import HEAD, TORSO
from crowdsim.poses.kernels.reactions import LENGTH, RISE, ROUNDS, Blows, Trunk, show_reactions, strengthen
from crowdsim.poses.kernels.records import Posed
from crowdsim.poses.layer import Layer, Part, Scheduler
from crowdsim.poses.limbs import chain_of
from crowdsim.poses.motion import PoseMotion

_EVEN, _STEEP, _MOST = (0.04, 0.1), (0.108, 0.06), (0.44, 0.36)
"""How far a typical blow brings the head, or the neck of one to the torso: whatever its impulse, by its fourth power,
and at the most, in a body of scale 1 [m]."""
_PUSH, _FURTHEST = 0.031, 0.1
"""How far a typical blow pushes the pelvis, by the square of its impulse, and at the most [m]."""
_GUARD, _GUARD_GIVES = 0.056, 0.1
"""How far a typical blow pushes the hand of an arm that stops it, by its impulse, and at the most [m]."""
_TWIST, _JAW, _LEVER = 0.35, 1.5, 0.1
"""How far a blow turns a head or trunk about the vertical, for what it does about the level, that hits it beside its
middle; how much more on the jaw; and how far beside it does so to the full [m]."""
_SWING, _KICK = 0.05, 0.1
"""Time over which the direction of a fist, and of a foot, is measured [s]."""
_THICK = 0.06
"""Radius of what strikes, by which it stays out of what it touches [m]."""
_GIVES = {"spine": (0.13, 0.25), "chest": (0.11, 0.2), "neck": (0.05, -0.1), "head": (0.02, 0.0)}
"""Joints that yield, and by how much in a blow to the head and to the torso [rad]."""
_LIMITS = {"spine": 0.7, "chest": 0.6, "neck": 0.5, "head": 0.3}
"""How far blows turn them at the most [rad]."""

_FOUND = np.dtype(
    [
        ("known", np.bool_), ("shows", np.bool_), ("part", np.int64), ("gain", np.float64), ("own", np.float64),
        ("room", np.float64), ("axis", np.float64, 3), ("push", np.float64, 3), ("gloves", np.float64, (2, 3)),
    ]
)  # fmt: skip
"""What is found of a strike, see ``Blows``, and how far its part goes for an axis of length 1, by itself and at the
most."""
_LATE = 0.35
"""How far back blows count further away [s]."""
FallsAt = Callable[[Array, Array], Array]


def build_trunk(motion: PoseMotion) -> Trunk:
    """Return the joints of a body that yield to strikes."""
    body, skeleton = motion.body, motion.skeleton
    chain = chain_of(skeleton, [body.roles["head"]])
    gives, limits, gains = np.zeros((len(chain), 2)), np.ones(len(chain)), np.zeros(2)
    ends = [*np.asarray(skeleton.offsets, dtype=float)[chain[1:]], np.asarray(body.head_offset, dtype=float)]
    for role, give in _GIVES.items():
        # A joint with two roles yields for both.
        gives[chain == body.roles[role]] += give
        limits[chain == body.roles[role]] = _LIMITS[role]
    neck = int(np.flatnonzero(chain == body.roles["neck"])[0])
    for at in range(len(chain)):
        for part, stop in ((HEAD, len(chain)), (TORSO, neck)):
            gains[part] += gives[at, part] * np.linalg.norm(np.sum(ends[at:stop], axis=0))
    return Trunk(np.asarray(skeleton.parents, dtype=np.int64), chain, gives, limits, gains)


class TrunksAt(NamedTuple):
    """Heads and trunks at a time; n bodies, NaN while absent.

    Attributes:
        heads: Shape (n, 3) [m].
        necks: Shape (n, 3) [m].
        pelvises: Shape (n, 3) [m].
        strikers: What they strike with. Shape (n, 11, 3) [m].
        sizes: Sizes of the bodies. Shape (n,).
        radii: Radius of the head and of the torso. Shape (n, 2) [m].
    """

    heads: Array
    necks: Array
    pelvises: Array
    strikers: Array
    sizes: Array
    radii: Array

    def parts(self, points: Array) -> Array:
        """Return ``HEAD`` for points (n, 3) [m] beyond the neck or nearer to the head, else ``TORSO``. Shape (n,)."""
        axis = self.pelvises - self.necks
        share = np.sum((points - self.necks) * axis, axis=1) / np.maximum(np.sum(axis * axis, axis=1), 1e-12)
        torso = np.linalg.norm(points - self.necks - np.clip(share, 0.0, 1.0)[:, None] * axis, axis=1)
        head = np.linalg.norm(points - self.heads, axis=1)
        nearer = head - self.radii[:, HEAD] < torso - self.radii[:, TORSO]
        return np.where((share < 0.0) | nearer, HEAD, TORSO)

    def room(self, others: TrunksAt, ways: Array) -> Array:
        """Return how far heads have to go over the ground to meet those of others, inf for never.

        Args:
            others: The others. n bodies.
            ways: Where heads go, of length 1. Shape (n, 2).

        Returns:
            Shape (n,) [m].
        """
        between = np.nan_to_num(others.heads - self.heads, nan=1e3)
        along, reach = np.sum(between[:, ::2] * ways, axis=1), self.radii[:, HEAD] + others.radii[:, HEAD]
        beside = reach**2 - np.sum(between[:, ::2] ** 2, axis=1) + along**2
        return np.where((along > 0.0) & (beside > 0.0), along - np.sqrt(np.maximum(beside, 0.0)), np.inf)

    def middles(self, parts: Array) -> Array:
        """Return the middle of heads, or of trunks, by ``parts`` (n,). Shape (n, 3) [m]."""
        return np.where((parts == HEAD)[:, None], self.heads, 0.5 * (self.necks + self.pelvises))

    def tops(self, parts: Array) -> Array:
        """Return what a blow brings along by ``parts`` (n,): heads, or necks as seen from the pelvis. (n, 3) [m]."""
        return np.where((parts == HEAD)[:, None], self.heads, self.necks - self.pelvises)


class BlowPlanner:
    """Finds what hits avatars; what it has found it keeps.

    Args:
        landed: The take's landed and blocked strikes.
        pose_at: Returns the joints of avatars with blends and separation alone.
        trunks: The joints that yield, policy by policy.
        typical: The speed of typical strikes, policy by policy, see ``PoseMotion.typical`` [m/s].
        cast: The avatars.
        falls: Returns which avatars (E,) are down at times (E,) [s], or will be at once: blows do not show on them.
    """

    def __init__(
        self,
        landed: Landed,
        pose_at: PoseAt,
        trunks: Sequence[Trunk],
        typical: Sequence[Array],
        cast: Cast,
        falls: FallsAt,
    ) -> None:
        self.landed, self._pose_at, self._trunks, self._cast = landed, pose_at, trunks, cast
        self._falls, self._typical = falls, np.array(typical)
        self._found = np.zeros(len(landed.times), _FOUND)
        self._found["shows"] = (landed.victims >= 0) & ~landed.again & ~landed.missed

    def plan(self, columns: Array, count: int, first: float, last: float) -> Blows:
        """Return what hits avatars of a window.

        Args:
            columns: Column of every avatar in the window, -1 for those that are not in it. Shape (N,).
            count: Number of columns.
            first: First time that is posed [s].
            last: Last time that is posed [s].
        """
        low, high = np.searchsorted(self.landed.times, (first - (ROUNDS + 1) * LENGTH, last))
        near = np.arange(low, high)[self._found["shows"][low:high]]
        near = near[columns[self.landed.victims[near]] >= 0]
        fresh = near[~self._found["known"][near]]
        if len(fresh):
            found = self.find(fresh).copy()
            known, found["known"] = found["known"].copy(), False
            self._found[fresh] = found
            # Last, since other threads read what is known.
            self._found["known"][fresh] = known
            near = near[self._found["shows"][near]]
        times = self.landed.times[near]
        order, starts = by_column(columns[self.landed.victims[near]], count, times)
        found, times = self._found[near[order]], times[order]
        names = ("axis", "part", "push", "gloves", "gain", "own", "room")
        *fields, gains, own, rooms = (np.ascontiguousarray(found[name]) for name in names)
        blows = Blows(starts, times, *fields)
        return blows._replace(axes=strengthen(blows, gains, own, rooms))

    def find(self, fresh: Array) -> Array:
        """Return what there is to know about strikes, given by number (E,). Shape (E,)."""
        near, found = self.landed.of(fresh), np.zeros(len(fresh), _FOUND)
        found["known"], found["shows"] = True, ~self._falls(near.victims, near.times)
        swings = np.where(np.isin(near.limbs, LEGS), _KICK, _SWING)
        hit, later, striker, after, earlier = self._trunks_at(
            (near.victims, near.times), (near.victims, near.times + RISE), (near.attackers, near.times),
            (near.attackers, near.times + RISE), (near.attackers, near.times - swings),
        )  # fmt: skip
        now, before = (one.strikers[np.arange(len(fresh)), near.limbs] for one in (striker, earlier))
        # A fist pushes along its way, and away from who strikes: a hook does both.
        fists, apart = (_unit(np.nan_to_num(way)[:, ::2]) for way in (now - before, hit.heads - striker.pelvises))
        ways = _unit(2.0 * fists + apart)
        # Where fists touch, which are carried there from where control has them.
        head_radii, torso_radii = (hit.radii + _THICK).T
        outline = hit.heads, hit.necks, hit.pelvises, head_radii, torso_radii
        touched = surface_point(now, *outline, origin=striker.necks)
        parts = hit.parts(touched)
        gains = np.array([trunk.gains for trunk in self._trunks])
        gains = gains[np.asarray(self._cast.policies)[near.victims], parts] * hit.sizes
        typical = self._typical[np.asarray(self._cast.policies)[near.attackers], near.limbs]
        impulses = near.speeds / typical * np.asarray(self._cast.scales, dtype=float)[near.attackers] ** 3
        impulses *= np.where(np.isin(near.limbs, LEGS), FOOT, 1.0) * np.where(near.blocked, GUARDED, 1.0)
        reaches = np.minimum(np.take(_EVEN, parts) + np.take(_STEEP, parts) * impulses**4, np.take(_MOST, parts))
        reaches *= hit.sizes * np.where(near.blocked, GUARDED, 1.0)
        # A fold brings the neck no further than there is room between the heads.
        rooms = np.minimum(hit.room(striker, -ways), later.room(after, -ways))
        found["room"] = np.where(parts == HEAD, np.inf, np.maximum(rooms, 0.0))
        reaches = np.minimum(reaches, found["room"])
        # Up cross direction: rotation about it tips upright vectors in the direction. Trunks fold over what hits them.
        over = np.where(parts == HEAD, 1.0, -1.0)
        aside = np.nan_to_num(touched - hit.middles(parts))
        twists = _TWIST * np.clip((aside[:, 2] * ways[:, 0] - aside[:, 0] * ways[:, 1]) / _LEVER, -1.0, 1.0)
        twists *= np.where((parts == HEAD) & (aside[:, 1] < 0.0), _JAW, 1.0)
        axes = np.stack([over * ways[:, 1], twists, -over * ways[:, 0]], axis=1)
        found["axis"] = axes * (reaches / np.maximum(gains, 1e-9))[:, None]
        found["part"] = parts
        pushes = np.minimum(_PUSH * impulses**2, _FURTHEST) * hit.sizes
        found["push"] = np.stack([ways[:, 0], np.zeros(len(ways)), ways[:, 1]], axis=1) * pushes[:, None]
        nearest = np.argmin(np.linalg.norm(hit.strikers[:, :2] - near.points[:, None], axis=-1), axis=1)
        stops = near.blocked[:, None] & (np.arange(2) == nearest[:, None])
        gives = np.minimum(_GUARD * impulses / GUARDED, _GUARD_GIVES) * hit.sizes
        along = np.stack([ways[:, 0], np.zeros(len(ways)), ways[:, 1]], axis=1) * gives[:, None]
        found["gloves"] = np.where(stops[..., None], along[:, None], 0.0)
        # What an arm stops need not be seen in head or trunk: blows without a gain stay as they are.
        found["gain"] = np.where(near.blocked, 0.0, gains)
        moved = np.nan_to_num(later.tops(parts) - hit.tops(parts))[:, ::2]
        found["own"] = np.min([over * np.sum(moved * way, axis=1) for way in (ways, fists, apart)], axis=0)
        return found

    def _trunks_at(self, *when: tuple[Array, Array]) -> list[TrunksAt]:
        """Return the heads, trunks and strikers of avatars (E,) at times (E,), once for each such pair."""
        avatars, times = (np.concatenate(part) for part in zip(*when, strict=True))
        heads, necks, pelvises = np.full((3, len(times), 3), np.nan)
        strikers = np.full((len(times), len(LIMBS), 3), np.nan)
        found = TrunksAt(heads, necks, pelvises, strikers, np.ones(len(times)), np.zeros((len(times), 2)))
        for which, body, scales, positions, rotations in self._pose_at(avatars, times):
            for values, points in zip(found[:4], body_points(body, positions, rotations, scales), strict=True):
                values[which] = points
            found.sizes[which] = scales
            found.radii[which, HEAD], found.radii[which, TORSO] = body.head_radius * scales, body.torso_radius * scales
        pieces = (np.split(values, len(when)) for values in found)
        return [TrunksAt(*piece) for piece in zip(*pieces, strict=True)]


class Reactions(Layer):
    """Blows throw heads back, fold trunks and push pelvises."""

    name = "reactions"
    size = 0.8
    reading = 0.06
    needs = ("separation",)
    looks = (ROUNDS + 1) * LENGTH + _KICK, RISE
    planner = BlowPlanner

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        self._trunks = [build_trunk(motion) for motion in poser.motions]
        self._planner: BlowPlanner | None = None

    def prepare(self, avatars: Array, first: float, last: float) -> None:
        """Find out about what hits avatars."""
        if self.poser.reactions:
            columns = np.full(self.poser.take.avatar_count, -1)
            columns[avatars] = np.arange(len(avatars))
            self._known().plan(columns, len(avatars), first, last)

    def plan(self, part: Part) -> Blows | None:
        """Return what hits avatars; None where nothing shows."""
        if not self.poser.reactions:
            return None
        blows = self._known().plan(part.window.columns(), len(part.window.avatars), *part.span)
        return blows if len(blows.times) else None

    def apply(self, part: Part, poses: Posed) -> None:
        """Add the reactions."""
        blows, trunk, recent = part.plans[self.name], self._trunks[part.policy], _LATE if part.hops > 1 else LENGTH
        if blows is not None:
            window = part.window
            arms, legs = window.motion.arms, window.motion.legs
            share(len(part.moments.columns), show_reactions, part.moments, blows, trunk, arms, legs,
                  window.rows.sizes, recent, poses, threads=window.threads)  # fmt: skip

    def _known(self) -> BlowPlanner:
        """What is known of the strikes that land."""
        poser = self.poser
        if self._planner is None or self._planner.landed is not poser.landed:
            falls = partial(falls_soon, poser.take, poser.motions)
            pose_at = partial(poser.joints, through=self.needs[0], hops=1)
            typical = [motion.typical for motion in poser.motions]
            self._planner = self.planner(poser.landed, pose_at, self._trunks, typical, poser.take.cast, falls)
        return self._planner


def _unit(vectors: Array) -> Array:
    """Vectors (n, 2) of length 1, or 0."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), 0.0)
