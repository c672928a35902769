"""Poses of a crowd while it is simulated, and what the player gets of each control frame.

A take knows what comes; a live crowd does not. Avatars are shown ``LAG`` control frames after they have been simulated,
so that fists that land are seen to do so, by the layers of poses that cost little. Bodies that sink into one another,
or whose arms pass through others, are parted only in the take.
"""

from __future__ import annotations

import json
import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.chunk import Frame
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.events import VARIABLES, Events
from crowdsim.crowd.explaining import Decision
from crowdsim.crowd.obstacles import pack_obstacles
from crowdsim.crowd.record import TakeData
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.strikes import HANDS
from crowdsim.poses.contacts import PoseAt, strikes_near
from crowdsim.poses.hits import Landed, by_column
from crowdsim.poses.kernels.fists import JOINTS, MOTION, Landings
from crowdsim.poses.kernels.reactions import Blows
from crowdsim.poses.layer import Layer, Part, Scheduler
from crowdsim.poses.layers import LAYERS
from crowdsim.poses.layers.fists import Fists, plan_landings
from crowdsim.poses.layers.floor import Floor, Settling
from crowdsim.poses.layers.reactions import BlowPlanner, Reactions, build_trunk
from crowdsim.poses.motion import prepare_motion
from crowdsim.poses.poser import Poser
from crowdsim.take.take import Take
from crowdsim.view.recording import Recording
from crowdsim.view.take_motion import record_take

if TYPE_CHECKING:
    from crowdsim.crowd.value_map import ValueMap
    from crowdsim.scenario.scenario import Scenario

LAG = 2
"""How long after it has been simulated a control frame is shown [control frames]."""
ROWS = 2
"""Poses in a control frame; the player interpolates between them."""
WITHOUT = frozenset({"separation", "deflection", "second deflection"})
"""Layers that live poses do without."""
_STIFFNESS, _FURTHEST = 20.0, 0.6
"""How fast offsets of poses die away [1/s], and the greatest that is no jump to another place [m]."""
_PLANNED = ("shifts", "goals", "stops", "rotations", "moves", "struck")
"""What is kept of the plan of a strike that lands, see ``Landings``."""
_WINDOW = 45
"""Control frames that live poses look back on; reactions to hits last no longer than that."""


class Played(Protocol):
    """What is simulated live, see ``play.session.Session``.

    Attributes:
        scenario: What is played.
        crowd: Its crowd.
        strikes: How many strikes have been thrown and landed so far.
    """

    scenario: Scenario
    crowd: Crowd
    strikes: dict[str, int]

    @property
    def frame(self) -> int:
        """Number of control frames done."""

    @property
    def is_over(self) -> bool:
        """Whether it has come to its end."""

    def step(self) -> Frame:
        """Run the next control frame and return it."""

    def restart(self) -> None:
        """Begin again."""

    def tunings(self) -> dict[str, dict[str, Any]]:
        """Return what can be tuned of each type, and its values now."""

    def explain(self) -> list[Decision]:
        """Return the decisions of the next control frame."""

    def value_map(self, avatar: int) -> ValueMap | None:
        """Return what an avatar's next action is worth by where its opponent stands."""

    def health(self) -> tuple[Array, Array]:
        """Return the health of each avatar now, and at the start. Shape (N,) each."""

    def down(self) -> Array:
        """Return which avatars fall, lie or get up. Shape (N,), bool."""

    def tune(self, kind: str, key: str, value: float) -> None:
        """Give avatars of a type another weight, temperature, tempo or time to react."""

    def set_on(self, avatar: int, opponent: int | None) -> None:
        """Let an avatar fight another one, or those of its group."""

    def remove(self, avatar: int) -> None:
        """Take an avatar out of the scene."""

    def add(self, avatar: int) -> None:
        """Let an avatar come back."""

    def place(self, avatar: int, x: float, z: float) -> str:
        """Put an avatar at a point, or beside it; return where that is [m]."""

    def heal(self, avatar: int | None = None) -> None:
        """Restore the health of an avatar, or of all."""

    def drag(self, target: int, x: float, y: float, z: float) -> None:
        """Let a target be at a point from the next control frame on [m]."""


class Settled:
    """Poses of one figure, without jumps when later frames change what is known of an avatar's motion.

    What was shown at a time and what is known of it now differ by an offset, which dies away as a critically damped
    spring does.

    Args:
        count: Number of avatars.
        joints: Number of joints.
        seconds: Times at which poses are shown, from the first one on; the last one is the first of the next poses [s].
    """

    def __init__(self, count: int, joints: int, seconds: Array) -> None:
        self._seconds = seconds
        # Root and rotation vectors of joints, and how fast they change.
        self._offsets = np.zeros((count, joints + 1, 3))
        self._speeds = np.zeros((count, joints + 1, 3))
        self._before: tuple[Array, Array] | None = None

    def settle(self, roots: Array, rotations: Array) -> tuple[Array, Array]:
        """Return poses as they are shown at all times but the last.

        Args:
            roots: Root positions as they are known now [m]. Shape (T, n, 3).
            rotations: Local rotations. Shape (T, n, J, 4).
        """
        if self._before is not None:
            gaps = self._before[0] - roots[0]
            turned = quaternion.multiply(self._before[1], quaternion.conjugate(rotations[0]))
            held = quaternion.from_rotation_vector(self._offsets[:, 1:])
            turns = quaternion.to_rotation_vector(quaternion.multiply(held, turned))
            offsets = np.concatenate([(self._offsets[:, 0] + gaps)[:, None], turns], axis=1)
            # Those that have come or gone, or are somewhere else at once, begin anew.
            anew = ~(np.isfinite(offsets).all(axis=(1, 2)) & (np.linalg.norm(gaps, axis=-1) < _FURTHEST))
            self._offsets, self._speeds[anew] = np.where(anew[:, None, None], 0.0, offsets), 0.0
        self._before = roots[-1], rotations[-1]
        rise = self._speeds + _STIFFNESS * self._offsets
        shown = [(self._offsets + rise * time) * np.exp(-_STIFFNESS * time) for time in self._seconds]
        last = self._seconds[-1]
        self._speeds = (self._speeds - rise * _STIFFNESS * last) * np.exp(-_STIFFNESS * last)
        self._offsets = shown[-1]
        moved = np.stack(shown[:-1])
        turns = quaternion.from_rotation_vector(moved[:, :, 1:])
        return roots[:-1] + moved[:, :, 0], quaternion.multiply(turns, rotations[:-1])


class Known:
    """What has been found of strikes by attacker, victim, limb and time, whichever take it was found in.

    Args:
        rate: Control frames a second.
    """

    def __init__(self, rate: float) -> None:
        self._rate, self._first, self._end = rate, 0, 0
        self.fists: dict[tuple[int, ...], tuple[Array, ...]] = {}
        self.blows: dict[tuple[int, ...], bytes] = {}

    def begin(self, first: int, end: int) -> None:
        """Forget strikes before a control frame; what is asked for from now on is of a take of frames until ``end``."""
        self._first, self._end = first, end
        for found in (self.fists, self.blows):
            for key in [one for one in found if one[-1] < 1000 * first]:
                del found[key]

    @property
    def until(self) -> float:
        """The last time whose frame and the next one have been simulated, of the take [s]."""
        return max(self._end - 2 - self._first, 0) / self._rate

    def keys(self, near: Landed) -> list[tuple[int, ...]]:
        """Return the keys of strikes of the take."""
        frames = np.rint(1000.0 * (near.times * self._rate + self._first)).astype(np.int64)
        return list(zip(*(one.tolist() for one in (near.attackers, near.victims, near.limbs, frames)), strict=True))


class NearBlows(BlowPlanner):
    """What hits avatars; it is planned once, a control frame after it has hit, and then kept."""

    strikes: ClassVar[Known]

    def plan(self, columns: Array, count: int, first: float, last: float) -> Blows:
        """Return what has hit avatars of a window."""
        return super().plan(columns, count, first, min(last, self.strikes.until))

    def find(self, fresh: Array) -> Array:
        """Return what there is to know about strikes, given by number (E,)."""
        keys, known = self.strikes.keys(self.landed.of(fresh)), self.strikes.blows
        some = np.flatnonzero([key not in known for key in keys])
        if len(some):
            known |= zip((keys[row] for row in some), (one.tobytes() for one in super().find(fresh[some])), strict=True)
        return np.frombuffer(b"".join([known[key] for key in keys]), self._found.dtype)


class PosedTogether:
    """Poses of avatars that are found at once, and asked for piece by piece: a call costs more than its poses.

    Args:
        pose_at: Poses avatars.
        avatars: All that will be asked for. Shape (E,).
        times: When [s]. Shape (E,).
    """

    def __init__(self, pose_at: PoseAt, avatars: Array, times: Array) -> None:
        self._found = pose_at(avatars, times)
        keys = list(zip(avatars.tolist(), times.tolist(), strict=True))
        self._rows = {
            keys[one]: (part, row)
            for part, (which, *_) in enumerate(self._found)
            for row, one in enumerate(which.tolist())
        }

    def __call__(self, avatars: Array, times: Array) -> list[tuple[Array, Body, Array, Array, Array]]:
        """Return some of them, see ``contacts.PoseAt``."""
        keys = zip(avatars.tolist(), times.tolist(), strict=True)
        rows = np.array([self._rows[key] for key in keys], np.int64).reshape(-1, 2)
        found = []
        for part, (_, body, scales, positions, rotations) in enumerate(self._found):
            which = np.flatnonzero(rows[:, 0] == part)
            if len(which):
                own = rows[which, 1]
                found.append((which, body, scales[own], positions[own], rotations[own]))
        return found


class NearFists(Fists):
    """Fists that touch bodies as these are without fists of their own, which saves posing further avatars.

    Where a fist touches is planned once, when the strike is known, and then kept.
    """

    needs = ("reactions", "reactions")
    hops = 0
    strikes: ClassVar[Known]

    def plan(self, part: Part) -> Landings:
        """Return where fists touch."""
        near, columns = strikes_near(self.poser.landed, part), part.window.columns()
        near, count = near.of(np.isin(near.limbs, HANDS)), len(part.window.avatars)
        keys, planned = self.strikes.keys(near), self.strikes.fists
        fresh = np.array([key not in planned for key in keys], bool)
        if fresh.any():
            some, rows = near.of(fresh), np.flatnonzero(fresh)
            hit = near.of(fresh & (near.victims >= 0))
            pose_at = PosedTogether(
                partial(self.poser.joints, through=self.needs[0], hops=part.hops + 1),
                np.concatenate([some.attackers, *[hit.victims] * 3]),
                np.concatenate([some.times, *(hit.times + apart for apart in (-MOTION, 0.0, MOTION))]),
            )
            landings = plan_landings(
                self.poser.take, some, columns, count, pose_at, pose_at, part.window.motion, part.hops
            )
            order, _ = by_column(columns[some.attackers], count, some.times)
            for place, row in enumerate(rows[order].tolist()):
                planned[keys[row]] = tuple(getattr(landings, name)[place] for name in _PLANNED)
        order, starts = by_column(columns[near.attackers], count, near.times)
        shifts, goals, stops, rotations, moves, struck = self._joined([planned[keys[row]] for row in order])
        return Landings(
            starts, near.times[order], near.hands[order], shifts, near.spans[order], goals, near.blocked[order], stops,
            rotations, moves, struck,
        )  # fmt: skip

    def _joined(self, rows: Sequence[tuple[Array, ...]]) -> list[Array]:
        """Return plans of strikes as arrays; where some are stopped by fewer capsules, NaN fills up."""
        if not rows:
            shapes = (0, 3), (0, 3), (0, 3, 0, 9), (0, JOINTS, 3), (0, 3)
            return [*map(np.zeros, shapes), np.zeros(0, np.int64)]
        most = max(row[2].shape[1] for row in rows)
        stops = np.full((len(rows), 3, most, 9), np.nan)
        for own, row in zip(stops, rows, strict=True):
            own[:, : row[2].shape[1]] = row[2]
        shifts, goals, rotations, moves, struck = (np.array([row[k] for row in rows]) for k in (0, 1, 3, 4, 5))
        return [shifts, goals, stops, rotations, moves, struck]


class LivePoses:
    """Poses of the last control frames of a crowd.

    Args:
        crowd: The crowd.
        reactions: Whether landed strikes move those whom they hit.
        collision_avoidance: Whether avatars avoid one another.
    """

    def __init__(self, crowd: Crowd, reactions: bool = True, collision_avoidance: bool = True) -> None:
        self._crowd, self._frames = crowd, deque[Frame](maxlen=_WINDOW)
        # Variables of the last frames lie one after another, up to ``_end``.
        self._rows: dict[str, Array] = {}
        self._end = 0
        self._reactions, self._avoids = reactions, collision_avoidance
        self._motions = [prepare_motion(policy) for policy in crowd.policies]
        settlings = [Settling(motion) for motion in self._motions]

        class KeptFloor(Floor):
            """The layer, without measuring again how bodies lie."""

            def __init__(self, poser: Scheduler) -> None:
                Layer.__init__(self, poser)
                self._settlings = settlings

        known = self._known = Known(crowd.rate)

        class KeptFists(NearFists):
            strikes = known

        class KeptBlows(NearBlows):
            strikes = known

        trunks = [build_trunk(motion) for motion in self._motions]

        class KeptReactions(Reactions):
            """The layer, with blows that are planned once."""

            planner = KeptBlows

            def __init__(self, poser: Scheduler) -> None:
                Layer.__init__(self, poser)
                self._trunks, self._planner = trunks, None

        kept = {Floor: KeptFloor, Fists: KeptFists, Reactions: KeptReactions}
        self._kinds = tuple(kept.get(kind, kind) for kind in LAYERS)
        self._policies = np.unique(crowd.cast.policies)
        self._owners = [np.flatnonzero(crowd.cast.policies == index) for index in self._policies]
        seconds = np.arange(ROWS + 1) / ROWS / crowd.rate
        self._settled = [
            Settled(len(owners), self._motions[index].skeleton.joint_count, seconds)
            for index, owners in zip(self._policies.tolist(), self._owners, strict=True)
        ]

    def add(self, frame: Frame) -> None:
        """Add the control frame that has just been simulated."""
        if not self._frames:
            shapes = {name: (2 * _WINDOW, *getattr(frame, name).shape) for name in VARIABLES}
            self._rows = {name: np.empty(shape, getattr(frame, name).dtype) for name, shape in shapes.items()}
        self._frames.append(frame)
        if self._end == 2 * _WINDOW:
            for rows in self._rows.values():
                rows[: _WINDOW - 1] = rows[_WINDOW + 1 :]
            self._end = _WINDOW - 1
        for name, rows in self._rows.items():
            rows[self._end] = getattr(frame, name)
        self._end += 1
        self._known.begin(self._frames[0].number, frame.number + 1)

    @property
    def shown(self) -> int:
        """The control frame that is shown now; negative where none is yet."""
        return self._frames[-1].number - LAG if self._frames else -1

    def frame(self) -> Frame:
        """Return the control frame that is shown now."""
        return self._frames[-1 - LAG]

    def poses(self) -> list[tuple[Array, Array]]:
        """Return ``ROWS`` poses from the frame that is shown now on, before the next one; once for each frame.

        For each policy that has avatars, in order, roots (ROWS, n, 3) [m] and local rotations (ROWS, n, J, 4), NaN of
        those that are absent.
        """
        take = self._take()
        count, first = self._crowd.count, self._frames[0].number
        # The last one is what is known now of the first of the next frame.
        times = (self.shown - first + np.arange(ROWS + 1) / ROWS) / self._crowd.rate
        there = np.flatnonzero(self.frame().action >= 0)
        found = [
            (
                np.full((ROWS + 1, len(owners), 3), np.nan, np.float32),
                np.full((ROWS + 1, len(owners), self._motions[index].skeleton.joint_count, 4), np.nan, np.float32),
            )
            for index, owners in zip(self._policies.tolist(), self._owners, strict=True)
        ]
        columns = np.zeros(count, np.int64)
        for owners in self._owners:
            columns[owners] = np.arange(len(owners))
        poser = Poser(take, self._motions, 1, self._reactions, WITHOUT, kinds=self._kinds)
        for block in poser.sample(there, times) if len(there) else ():
            roots, rotations = found[int(np.searchsorted(self._policies, block.part.policy))]
            some = columns[there[block.which]]
            roots[:, some], rotations[:, some] = block.poses
        return [settled.settle(*one) for settled, one in zip(self._settled, found, strict=True)]

    def _take(self) -> TakeData:
        """Return the last control frames as a take of their own."""
        frames, first = list(self._frames), self._frames[0].number
        thrown = [frame.events for frame in frames if len(frame.events.frame)] or [frames[0].events]
        events = {one.name: np.concatenate([getattr(each, one.name) for each in thrown]) for one in fields(Events)}
        events["frame"] = (events["frame"] - first).astype(np.float32)
        variables: dict[str, Any] = {name: self._rows[name][self._end - len(frames) : self._end] for name in VARIABLES}
        return TakeData(
            **variables,
            cast=self._crowd.cast,
            targets=np.stack([frame.targets for frame in frames]),
            target_names=tuple(map(str, range(len(frames[0].targets)))),
            events=Events(**events),
            control_rate=self._crowd.rate,
            scenario="live",
            seed=self._crowd.seed,
            fingerprints=(),
            status="running",
            reactions=self._reactions,
            collision_avoidance=self._avoids,
            policies=tuple(self._crowd.policies),
        )


def live_recording(played: Played) -> Recording:
    """Return what the player shows beside motion: a recording of one frame, with all avatars where they begin."""
    crowd, scenario = played.crowd, played.scenario
    none = np.zeros(0)
    events = Events(
        **{one.name: none.astype(np.int32) for one in fields(Events) if one.name not in ("point", "limb", "outcome")},
        point=np.zeros((0, 3)),
    )

    def row(values: Any, dtype: Any) -> Array:
        return np.broadcast_to(np.asarray(values, dtype), (1, crowd.count)).copy()

    start = Take(
        action=row(0, np.int32),
        action_frame=row(0, np.float32),
        x=row(crowd.x, np.float32),
        z=row(crowd.z, np.float32),
        heading=row(crowd.heading, np.float32),
        opponent=row(-1, np.int32),
        cast=crowd.cast,
        targets=np.stack([path.positions(np.zeros(1))[0] for path in crowd.targets])[None].astype(np.float32)
        if crowd.targets
        else np.zeros((1, 0, 3), np.float32),
        target_names=tuple(scenario.targets),
        events=events,
        control_rate=crowd.rate,
        scenario=scenario.name,
        seed=scenario.seed,
        fingerprints=tuple(policy.fingerprint for policy in crowd.policies),
        status="running",
        policies=tuple(crowd.policies),
    )
    health = {name: kind.damage.health for name, kind in scenario.types.items() if kind.damage is not None}
    recording = record_take(
        start, crowd.rate * ROWS, arena=crowd.arena, health=health, obstacles=pack_obstacles(scenario, None)
    )
    live = {
        "lag": LAG,
        "rows": ROWS,
        "clips": [[str(name) for name in policy.database.clip_names] for policy in crowd.policies],
        "policies": crowd.cast.policies.tolist(),
        "start": [round(float(crowd.x[0]), 3), round(float(crowd.z[0]), 3)],
    }
    # What a camera of a fight shows follows from all of it.
    cameras = {name: one for name, one in recording.cameras.items() if not one.slow}
    return replace(recording, cameras=cameras, more={"live": live})


def clips_of(crowd: Crowd, frame: Frame) -> tuple[Array, Array]:
    """Return the clip of its policy that each avatar's motion is from, and the frame of the clip. Shape (N,) each."""
    clip, place = np.full(crowd.count, -1, np.int32), np.zeros(crowd.count, np.int32)
    for index, policy in enumerate(crowd.policies):
        own = np.flatnonzero((crowd.cast.policies == index) & (frame.action >= 0))
        database = policy.database
        first = np.asarray(policy.graph.action_first)[frame.action[own]].astype(np.int64) - 1
        clip[own] = np.searchsorted(database.clip_starts, first, side="right") - 1
        start = (first - np.asarray(database.clip_starts)[clip[own]]) * database.stride
        place[own] = start + np.floor(frame.action_frame[own] * database.stride).astype(np.int32)
    return clip, place


def pack_frame(document: dict[str, Any], poses: Sequence[tuple[Array, Array]], bits: Sequence[Array]) -> bytes:
    """Return what the player gets of a control frame in one piece.

    It begins with the length of a JSON document, four bytes with the lowest first, and the document. For each figure
    rotations follow as int16 in steps of ``1 / (2 ** (bits - 1) - 1)``, (ROWS, n, J, 4), and root positions as float32,
    (ROWS, n, 3), each padded to a multiple of four bytes.

    Args:
        document: Plain data.
        poses: Roots and rotations of each figure, see ``LivePoses.poses``.
        bits: Bits of the rotations of each figure's joints, (J,).
    """
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    parts = [struct.pack("<I", len(text) + -len(text) % 4), text + b" " * (-len(text) % 4)]
    for (roots, rotations), bit in zip(poses, bits, strict=True):
        steps = (2.0 ** (np.asarray(bit) - 1) - 1.0)[:, None]
        whole = np.rint(np.nan_to_num(rotations) * steps).astype("<i2").tobytes()
        parts += [whole + b"\0" * (-len(whole) % 4), np.nan_to_num(roots).astype("<f4").tobytes()]
    return b"".join(parts)
