"""A policy's motion as poses need it: rotations without heading, positions in the ground frame, soles and hinges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowdsim.core.easing import ease
from crowdsim.core.types import Array
from crowdsim.motion import ground, quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.contacts import plant_spans
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.rests import DOWN, UP
from crowdsim.motion.skeleton import Skeleton
from crowdsim.motion.strikers import GROUPS, LIMBS
from crowdsim.poses.facing import chest_direction, face_direction
from crowdsim.poses.gait import Gait, measure_gait
from crowdsim.poses.kernels.columns import LOWER, UPPER
from crowdsim.poses.limbs import Hinges, Limbs, chain_of, limbs_among, measure_hinges, measure_limbs

if TYPE_CHECKING:
    from crowdsim.motion.database import MotionDatabase
    from crowdsim.policy.policy import Policy
    from crowdsim.policy.rewards import TargetBody


_SETTLES = 2
"""Frames at the ends of a foot plant in which the foot still comes to rest, or begins to lift."""
_SAMPLE = 4096
_EVEN = 0.03
"""Difference of heights over which one leg takes over from the other [m]."""
_LIES, _STANDS = 0.15, 0.5
"""Share of its length up to which a leg that reaches down does not carry the body, and from which on it does."""


class Frames(NamedTuple):
    """Playback frames for compiled code; P frames, J joints.

    Attributes:
        rotations: Local rotations, the root's without the heading, continuous in sign in a clip. Shape (P, J, 4),
            float32.
        roots: Position of the root in the frame's ground frame [m]. Shape (P, 3), float32.
        reaches: How far below its hip the ankle of the leg is that the body rests on, 0 where it rests on none [m].
            Shape (P,), float32.
        ground: Ground transform in the clip's world. Shape (P, 3), float64.
        contacts: Whether each foot is planted. Shape (P, 2), bool.
        holds: Point of each foot about which it rotates while it is planted, in the frame's ground frame [m].
            Shape (P, 2, 3), float32.
        feet: Turn of each foot in the frame's ground frame. Shape (P, 2, 4), float32.
        tracks: That point and the turn of each foot in the clip's world, and the turn of its toes on it, if there are
            any. Shape (P, 2, 11), float32.
        plants: First and last frame over which each foot stays planted as in this one, or is in the air as in this
            one. Shape (P, 2, 2), int32.
        bounds: First and last playback frame of the clip of each frame. Shape (P, 2).
        stride: Playback frames in a control frame.
        rate: Playback frames a second.
    """

    rotations: Array
    roots: Array
    reaches: Array
    ground: Array
    contacts: Array
    holds: Array
    feet: Array
    tracks: Array
    plants: Array
    bounds: Array
    stride: int
    rate: float


@dataclass(frozen=True)
class PoseMotion:
    """P playback frames of a skeleton of J joints, ready to be posed; A actions.

    Attributes:
        skeleton: The skeleton.
        body: What it is as a body.
        segments: What each of its joints carries, see ``builds.joint_segments``. Shape (J,).
        target: The body of scripted targets that it strikes.
        frames: The frames.
        legs: The legs.
        arms: The arms.
        hinges: Elbows and knees.
        gait: How it steps.
        trunks: Centre of the head, upper and lower end of the trunk in the frame's ground frame [m]. Shape (P, 3, 3),
            float32.
        looks: Heading of the face and of the chest in the frame's ground frame [rad]. Shape (P, 2), float32.
        strikes: Playback frames at which strikes reach furthest, ascending. Shape (S,).
        typical: Median of the speeds of strikes with each kind of striker, infinite where there are none [m/s].
            Shape (strikers,).
        origins: Playback frame that lies on the avatar when each action starts. Shape (A,).
        lengths: Length of each action [control frames]. Shape (A,).
        shifts: Where the ground transform of that frame lies then, as seen from the avatar's. Shape (A, 3).
        down: Whether a body falls, lies or gets up in each frame; its feet then count as planted in none.
            Shape (P,), bool.
        breathes: Which way a breath bends the trunk in each frame: 1 forward, of a body that lies on its back, -1
            backward, of one at ease or face down; 0 elsewhere. Shape (P,), float32.
    """

    skeleton: Skeleton
    body: Body
    segments: Array
    target: TargetBody
    frames: Frames
    legs: Limbs
    arms: Limbs
    hinges: Hinges
    gait: Gait
    trunks: Array
    looks: Array
    strikes: Array
    typical: Array
    origins: Array
    lengths: Array
    shifts: Array
    down: Array
    breathes: Array

    def frames_at(self, actions: Array, done: Array) -> Array:
        """Return the playback frames that are nearest after ``done`` control frames of actions. All of shape (n,)."""
        steps = np.minimum(done, self.lengths[actions]) * self.frames.stride
        return self.origins[actions] + np.rint(steps).astype(np.int64)

    @cached_property
    def of_legs(self) -> PoseMotion:
        """The motion of legs and toes alone, and of what they hang on."""
        return self.of_joints(chain_of(self.skeleton, [*self.legs.joints[:, LOWER], *self.legs.toes]))

    def of_joints(self, joints: Array) -> PoseMotion:
        """Return the motion of some joints (n,), ascending, all that they hang on among them.

        It does for blends, and for feet where the joints of legs and toes are among them.
        """
        skeleton, hinges = self.skeleton, np.isin(self.hinges.joints, joints)
        parents = np.asarray(skeleton.parents)[joints]
        places = np.where(parents >= 0, np.searchsorted(joints, parents), -1).astype(np.int32)
        some = Hinges(*(np.ascontiguousarray(values[hinges]) for values in self.hinges))
        return replace(
            self,
            skeleton=Skeleton(tuple(skeleton.names[joint] for joint in joints), places, skeleton.offsets[joints]),
            segments=self.segments[joints],
            frames=self.frames._replace(rotations=np.ascontiguousarray(self.frames.rotations[:, joints])),
            hinges=some._replace(joints=np.searchsorted(joints, some.joints)),
            legs=limbs_among(self.legs, joints),
            arms=limbs_among(self.arms, joints),
        )


def prepare_motion(policy: Policy) -> PoseMotion:
    """Return a policy's motion ready to be posed."""
    database, graph = policy.database, policy.graph
    skeleton, body, stride = database.skeleton, database.body, database.stride
    starts = np.asarray(database.clip_starts, dtype=np.int64) * stride
    headings = quaternion.about_y(-database.ground[:, 2]).astype(np.float32)
    rotations = np.array(database.rotations, dtype=np.float32)
    rotations[:, 0] = quaternion.multiply(headings, rotations[:, 0])
    _align_signs(rotations, starts)
    positions, world_rotations = forward_kinematics(skeleton, database.root_positions, database.rotations)
    telling = np.repeat(database.telling, stride)
    some = np.flatnonzero(telling)[:: max(1, np.count_nonzero(telling) // _SAMPLE)]
    sample = positions[some], world_rotations[some]
    bends = np.array([body.roles["spine"], body.roles["chest"]])
    legs = measure_limbs(skeleton, body, ("hip", "knee", "foot"), body.sole_offsets, bends[:0], sample)
    feet = legs.joints[:, 2]
    holds = positions[:, feet] + quaternion.rotate(world_rotations[:, feet], legs.holds)
    down = fallen_frames(database)
    contacts = np.array(database.contacts, dtype=bool) & ~down[:, None]
    clip = np.searchsorted(starts, np.arange(starts[-1]), side="right") - 1
    frames = Frames(
        rotations=rotations,
        roots=ground.to_local(database.ground, database.root_positions).astype(np.float32),
        reaches=leg_reaches(positions[:, legs.joints, 1], _length(legs)),
        ground=np.array(database.ground, dtype=np.float64),
        contacts=contacts,
        holds=ground.to_local(database.ground[:, None], holds).astype(np.float32),
        feet=quaternion.multiply(headings[:, None], world_rotations[:, feet]).astype(np.float32),
        tracks=_tracks(holds, world_rotations[:, feet], rotations, legs.toes),
        plants=_at_rest(contacts, starts),
        bounds=np.stack([starts[clip], starts[clip + 1] - 1], axis=1),
        stride=stride,
        rate=float(database.playback_rate),
    )
    fists = np.repeat(body.fist_offsets[:, None], 2, axis=1)
    return PoseMotion(
        skeleton=skeleton,
        body=body,
        segments=legs.segments,
        target=policy.body,
        frames=frames,
        legs=legs,
        arms=measure_limbs(skeleton, body, ("shoulder", "elbow", "hand"), fists, bends, sample),
        hinges=measure_hinges(skeleton, body, positions[telling]),
        gait=measure_gait(contacts[telling], holds[telling], _kept(starts, telling), float(database.playback_rate)),
        trunks=np.stack([database.heads, database.necks, database.pelvises], axis=1),
        looks=_looks(body, skeleton, headings, world_rotations),
        strikes=np.asarray(database.strike_frames, dtype=np.int64),
        typical=_typical_speeds(database),
        origins=(np.asarray(graph.action_first, dtype=np.int64) - 1) * stride,
        lengths=np.asarray(graph.action_lengths, dtype=np.int64),
        shifts=np.asarray(policy.actions.shifts, dtype=np.float64),
        down=down,
        breathes=_breathes(database, body, positions),
    )


def _typical_speeds(database: MotionDatabase) -> Array:
    found, speeds = np.full(len(LIMBS), np.inf), np.asarray(database.strike_speeds, dtype=float)
    for limbs in GROUPS.values():
        struck = speeds[np.isin(database.strike_limbs, limbs)]
        if len(struck):
            found[list(limbs)] = np.median(struck)
    return found


def _kept(starts: Array, telling: Array) -> Array:
    """Return where clips begin among the telling frames, with a cut wherever others lie between, and their number."""
    cuts = np.concatenate([starts, np.flatnonzero(np.diff(telling.astype(np.int8))) + 1])
    return np.unique(np.concatenate([[0], np.cumsum(telling)])[cuts])


def _looks(body: Body, skeleton: Skeleton, headings: Array, world_rotations: Array) -> Array:
    """Headings of face and chest (P, 2) [rad], turned by ``headings`` (P, 4), for joints with rotations (P, J, 4)."""
    found = [
        quaternion.rotate(quaternion.multiply(headings, world_rotations[:, body.roles[role]]), ahead)
        for role, ahead in (("head", face_direction(body)), ("chest", chest_direction(body, skeleton)))
    ]
    return np.stack([np.arctan2(look[:, 0], look[:, 2]) for look in found], axis=1).astype(np.float32)


def leg_reaches(heights: Array, length: float) -> Array:
    """Return how far below its hip the ankle of the leg is that a body rests on, 0 where it rests on none [m].

    It is the greatest of both legs' and 0, rounded over ``_EVEN``, so that bodies do not jerk where they shift their
    weight; less where legs hardly carry the body, since it kneels or sits, and 0 where it lies.

    Args:
        heights: Heights of hips, knees and ankles [m]. Shape (P, 2, 3).
        length: Length of a leg [m].

    Returns:
        Shape (P,), float32.
    """
    down = (heights[:, :, UPPER] - heights[:, :, LOWER]).astype(float) / _EVEN
    reaches = _EVEN * np.logaddexp(0.0, np.logaddexp(down[:, 0], down[:, 1]))
    carried = ease((reaches / length - _LIES) / (_STANDS - _LIES))
    return np.asarray(reaches * carried, np.float32)


def _length(limbs: Limbs) -> float:
    """The length of the first of two limbs [m]."""
    found, at = 0.0, int(limbs.joints[0, LOWER])
    while at != limbs.joints[0, UPPER]:
        found += float(np.linalg.norm(limbs.offsets[at]))
        at = int(limbs.parents[at])
    return found


def fallen_frames(database: MotionDatabase) -> Array:
    """Return which playback frames lie between standing and standing of a fall. Shape (P,), bool."""
    down = np.zeros(database.frame_count * database.stride, bool)
    for start, stop in zip(database.falls.starts, database.falls.stops, strict=True):
        down[int(start) * database.stride + 1 : int(stop) * database.stride] = True
    return down


def _breathes(database: MotionDatabase, body: Body, positions: Array) -> Array:
    """Return which way a breath bends the trunk in each playback frame, see ``PoseMotion``. Shape (P,), float32."""
    found = np.zeros(database.frame_count * database.stride, np.float32)
    for row in database.rests.frames.astype(int):
        found[row[DOWN] * database.stride : row[UP] * database.stride + 1] = -1.0
    across = positions[:, body.roles["left_hip"]] - positions[:, body.roles["right_hip"]]
    trunk = positions[:, body.roles["neck"]] - positions[:, body.roles["left_hip"]]
    faces_up = np.cross(across, trunk)[:, 1] > 0.0
    for down, rise in zip(database.falls.downs.astype(int), database.falls.rises.astype(int), strict=True):
        some = slice(down * database.stride, rise * database.stride + 1)
        found[some] = np.where(faces_up[some], 1.0, -1.0)
    return found


def _tracks(holds: Array, world_rotations: Array, rotations: Array, toes: Array) -> Array:
    """Return what each foot does in its clip's world, side by side."""
    tracks = np.zeros((len(holds), 2, 11), np.float32)
    tracks[..., :3], tracks[..., 3:7], tracks[..., 7] = holds, world_rotations, 1.0
    there = toes >= 0
    tracks[:, there, 7:] = rotations[:, toes[there]]
    return tracks


def _at_rest(contacts: Array, starts: Array) -> Array:
    """Return the frames over which each foot stays planted, without those in which it comes to rest or lifts off."""
    spans, frames = plant_spans(contacts, starts), np.arange(len(contacts))[:, None]
    first, last = np.minimum(spans[..., 0] + _SETTLES, frames), np.maximum(spans[..., 1] - _SETTLES, frames)
    rest = np.stack([first, last], axis=-1)
    return np.where(contacts[..., None], rest, plant_spans(~contacts, starts)).astype(np.int32)


def _align_signs(rotations: Array, starts: Array) -> None:
    """Give the rotations of a joint in all clips the sign that lies nearest to its first clip's, in place."""
    first = rotations[starts[0] : starts[1]].sum(axis=0)
    for start, stop in pairwise(starts[1:]):
        dots = np.sum(rotations[start:stop].sum(axis=0) * first, axis=-1)
        rotations[start:stop] *= np.where(dots < 0.0, -1.0, 1.0)[None, :, None].astype(np.float32)
