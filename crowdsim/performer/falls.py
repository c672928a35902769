"""Falls of the embedded boxer: to the floor after a hit, lying there, and up again; and staggers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion import quaternion as quat
from crowdsim.performer.fall_poses import LYING, PLUNGES, RISEN, STANCE, Foot, Hand, Key
from crowdsim.performer.phrases import exchange_blows
from crowdsim.performer.plan import Choreographer
from crowdsim.performer.score import Channel, Fall, Pose, Score, Stagger, Style, Vector

FALLS = tuple(PLUNGES)
"""Kinds of falls, by where the trunk goes."""
_GUARD, _AFTER = 1.15, 1.15
"""Time in the guard before a fall, and after it [s]."""
_SETTLES, _LIES = 1.02, 2.0
"""From the hit until the body lies, and how long it does [s]."""
_STEPS = (1.66, 1.90, 2.38)
"""When the rear foot is halfway to its print, and there, and when the guard stands again, after the body began to rise
[s]."""


def write_fall(kind: str, rng: np.random.Generator, facing: float | None = None, fights: bool = False) -> Score:
    """Plan a clip of one fall: a second in the guard, the fall, lying, getting up, and a second in the guard.

    Args:
        kind: A word of ``FALLS``.
        rng: Where every number is drawn from.
        facing: Heading of the stance at the start [rad]; drawn when None.
        fights: Whether the boxer fights before the fall and after it, instead of standing in the guard.
    """
    plunge = PLUNGES[kind]
    plan = Choreographer(rng, facing)
    start = _hit(plan, fights)
    quick, slow = float(rng.uniform(0.94, 1.06)), float(rng.uniform(0.94, 1.08))
    before, prints = plan.ground_frame.copy(), plan.prints.copy()
    down = start + quick * _SETTLES
    rise = down + _LIES
    left, ahead, turn = _drawn(plunge.risen, rng)
    plan.move(down + 0.5, ahead, left, turn)
    frames = {
        STANCE: before,
        LYING: ground.compose(before, _drawn(plunge.lying, rng)),
        RISEN: plan.ground_frame,
    }
    writer = _Writer(plan.style, frames, {STANCE: prints, LYING: prints, RISEN: plan.prints}, rng)
    end = rise + slow * _STEPS[2]
    poses = [writer.guard(start - 0.2, STANCE), writer.guard(start, STANCE)]
    poses += [writer.pose(key, start + quick * key.time) for key in plunge.down]
    lain = writer.pose(plunge.lies, down)
    poses += [lain, writer.at(lain, rise)]
    poses += [writer.pose(key, rise + slow * key.time) for key in plunge.up]
    landed = writer.guard(rise + slow * _STEPS[1], RISEN)
    poses += [writer.stepping(poses[-1], landed, rise + slow * _STEPS[0]), landed, writer.at(landed, end)]
    fall = Fall(kind, start, down, rise, end, tuple(_with_props(poses)))
    return plan.finish(_go_on(plan, end, fights), falls=(fall,))


def _hit(plan: Choreographer, fights: bool) -> float:
    """Return when the body is hit: after some time in the guard, or in the middle of an exchange of blows [s]."""
    rng = plan.rng
    if not fights:
        return _GUARD + float(rng.uniform(0.0, 0.15))
    over = exchange_blows(plan, float(rng.uniform(0.3, 0.5)), _GUARD)
    return max(over - float(rng.uniform(0.05, 0.45)), plan.feet_free, plan.last_hit + 0.05)


def _go_on(plan: Choreographer, end: float, fights: bool) -> float:
    """Return when a clip ends that goes on after ``end``: with the guard, or with an exchange of blows [s]."""
    if not fights:
        return end + _AFTER
    return exchange_blows(plan, end + float(plan.rng.uniform(0.0, 0.1)), _AFTER) + 0.3


def _drawn(frame: Vector, rng: np.random.Generator) -> tuple[float, float, float]:
    """Return a ground frame near a given one (x, z [m], heading [degrees]), its heading in radians."""
    x, z, heading = frame
    dx, dz, turn = rng.uniform(-1.0, 1.0, 3)
    return x + 0.03 * dx, z + 0.03 * dz, float(np.radians(heading + 5.0 * turn))


class _Writer:
    """Turns keys into poses in the world.

    Args:
        style: How the boxer stands.
        frames: Ground transform of each frame that keys are written in.
        prints: Footprints (x, z, yaw) in each of them, lead and rear. Shape (2, 3).
        rng: Where small differences are drawn from.
    """

    def __init__(self, style: Style, frames: dict[str, Array], prints: dict[str, Array], rng: np.random.Generator):
        self.style, self.frames, self.prints, self.rng = style, frames, prints, rng

    def guard(self, time: float, frame: str) -> Pose:
        """Return the guard in a frame."""
        style = self.style
        middle = ground.to_local(self.frames[frame], np.insert(self.prints[frame][:, :2].mean(axis=0), 1, 0.0))
        key = Key(
            0.0,
            frame,
            (float(middle[0]), style.height, float(middle[2])),
            (np.degrees(style.blade), np.degrees(0.45 * style.lean), 0.0, 0.0),
            (np.degrees(style.twist), np.degrees(0.55 * style.lean), 0.0),
            (-4.0, -np.degrees(style.blade + style.twist) * 0.75),
            Hand(elbow=np.degrees(style.elbows[0])),
            Hand(elbow=np.degrees(style.elbows[1])),
            Foot(pitch=np.degrees(style.heels[0])),
            Foot(pitch=np.degrees(style.heels[1])),
        )
        return self.pose(key, time)

    def pose(self, key: Key, time: float) -> Pose:
        """Return a key's pose at a time [s]."""
        frame = self.frames[key.frame]
        yaw, pitch, bend, spin = np.radians(key.turned)
        turned = quat.multiply(quat.from_euler(np.array([yaw, pitch, -bend]), "YXZ"), quat.about_y(spin))
        hands = [self._hand(hand, side, key.frame) for side, hand in enumerate((key.lead, key.rear))]
        feet = [self._foot(foot, side, key.frame) for side, foot in enumerate((key.lead_foot, key.rear_foot))]
        return Pose(
            time=time,
            hips=_vector(ground.to_world(frame, np.array(key.hips))),
            rotation=tuple(quat.multiply(quat.about_y(frame[2]), turned).tolist()),
            spine=_vector(np.radians(key.spine)),
            head=_pair(np.radians(key.head)),
            hands=(hands[0][0], hands[1][0]),
            props=(hands[0][1], hands[1][1]),
            propped=(float(key.lead.propped), float(key.rear.propped)),
            elbows=_pair(np.radians([key.lead.elbow, key.rear.elbow])),
            balls=(feet[0][0], feet[1][0]),
            yaws=(feet[0][1], feet[1][1]),
            pitches=_pair(np.radians([key.lead_foot.pitch, key.rear_foot.pitch])),
            splays=_pair(np.radians([key.lead_foot.splay, key.rear_foot.splay])),
        )

    def _hand(self, hand: Hand, side: int, frame: str) -> tuple[Vector, Vector]:
        """Return a fist in the chest's frame, and in the world where it is propped."""
        style = self.style
        if hand.at is None or hand.propped:
            rest = np.array((style.lead_fist, style.rear_fist)[side])
            towards = quat.from_euler(np.array([style.blade + style.twist, style.lean, 0.0]), "YXZ")
            held = quat.rotate(quat.conjugate(towards), rest)
        else:
            held = np.array(hand.at)
        nowhere = (np.nan, np.nan, np.nan)
        prop = _vector(ground.to_world(self.frames[frame], np.array(hand.at))) if hand.propped else nowhere
        return _vector(held), prop

    def _foot(self, foot: Foot, side: int, frame: str) -> tuple[Vector, float]:
        """Return the ball of a foot in the world, and its heading."""
        x, z, yaw = self.prints[frame][side]
        if foot.ball is None:
            return (float(x), 0.0, float(z)), float(yaw)
        at = self.frames[frame]
        # A heading continues from that of the print.
        turned = float(yaw + ground.wrap(at[2] + np.radians(foot.yaw) - yaw))
        return _vector(ground.to_world(at, np.array(foot.ball))), turned

    @staticmethod
    def at(pose: Pose, time: float) -> Pose:
        """Return a pose at another time [s]."""
        return Pose(**{**vars(pose), "time": time})

    @staticmethod
    def stepping(before: Pose, after: Pose, time: float) -> Pose:
        """Return the pose halfway between two, the rear foot in the air."""

        def halfway(a: ArrayLike, b: ArrayLike) -> Array:
            return 0.5 * (np.asarray(a, float) + np.asarray(b, float))

        ball = halfway(before.balls[1], after.balls[1]) + np.array([0.0, 0.07, 0.0])
        return Pose(
            **{
                **vars(after),
                "time": time,
                "hips": _vector(halfway(before.hips, after.hips)),
                "spine": _vector(halfway(before.spine, after.spine)),
                "balls": (after.balls[0], _vector(ball)),
                "pitches": (after.pitches[0], 0.7 * before.pitches[1] + 0.3 * after.pitches[1]),
            }
        )


def _with_props(poses: list[Pose]) -> list[Pose]:
    """Return poses with a prop for each hand at any time: the next one, or the last."""
    props = np.array([pose.props for pose in poses])
    for side in range(2):
        known = np.flatnonzero(np.isfinite(props[:, side, 0]))
        if not len(known):
            props[:, side] = 0.0
            continue
        following = known[np.minimum(np.searchsorted(known, np.arange(len(props))), len(known) - 1)]
        props[:, side] = props[following, side]
    return [
        Pose(**{**vars(pose), "props": tuple(_vector(prop) for prop in row)})
        for pose, row in zip(poses, props, strict=True)
    ]


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


STAGGERS = {"stagger_back": (-1.0, 0.0), "stagger_left": (0.0, 1.0), "stagger_right": (0.0, -1.0)}
"""Kinds of staggers, by where the trunk is thrown: ahead, to the left."""


def write_stagger(kind: str, rng: np.random.Generator, facing: float | None = None, fights: bool = False) -> Score:
    """Plan a clip of one stagger: a second in the guard, catching steps after a hit, and a second in the guard.

    Args:
        kind: A key of ``STAGGERS``.
        rng: Where every number is drawn from.
        facing: Heading of the stance at the start [rad]; drawn when None.
        fights: Whether the boxer fights before and after that, instead of standing in the guard.
    """
    ahead, left = STAGGERS[kind]
    plan = Choreographer(rng, facing)
    start = _hit(plan, fights)
    hit = float(rng.uniform(1.02, 1.12))
    end = start + 0.10
    for share in (1.0, 0.9, 0.45)[: 3 if rng.uniform() < 0.5 or left == 0.0 else 2]:
        far = hit * share * float(rng.uniform(0.33, 0.39))
        end = plan.move(end, far * ahead, far * left, float(rng.normal(0.0, 0.05)), 1.25, quick=True)
    peak, fall = start + 0.24, start + 0.36

    def throw(channel: Channel, size: float, late: float = 0.0) -> None:
        plan.accent(channel, hit * size, start, peak + late, fall + late, end + 0.25)

    throw(Channel.SHIFT_X, 0.03 * left)
    throw(Channel.SHIFT_Z, 0.06 * ahead)
    throw(Channel.HEIGHT, -0.05, 0.1)
    throw(Channel.PELVIS_TILT, 0.44 * ahead)
    throw(Channel.FLEX, 0.44 * ahead)
    throw(Channel.PELVIS_BEND, 0.46 * left)
    throw(Channel.BEND, 0.66 * left)
    throw(Channel.HEAD_NOD, 0.32 * ahead, -0.06)
    throw(Channel.HEAD_BEND, 0.25 * left, -0.06)
    for side, lead in ((Channel.LEAD_HAND_X, 1.0), (Channel.REAR_HAND_X, -1.0)):
        throw(side, 0.12 * lead, 0.05)
    for side in (Channel.LEAD_HAND_Y, Channel.REAR_HAND_Y):
        throw(side, -0.14, 0.08)
    for side in (Channel.LEAD_ELBOW, Channel.REAR_ELBOW):
        throw(side, 0.5, 0.05)
    done = end + 0.30
    return plan.finish(_go_on(plan, done, fights), staggers=(Stagger(kind, start, done),))
