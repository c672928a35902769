"""A recorded run as motion for the player."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from crowdsim.body.anatomy import Build
from crowdsim.body.looks import build_of
from crowdsim.body.palette import avatar_paints, capsule_paints, skin_paints, team_colour
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.body.skin import Skin, build_skin_of
from crowdsim.core.types import Array
from crowdsim.crowd.events import OUTCOMES
from crowdsim.errors import TakeError
from crowdsim.motion.body import PARTS
from crowdsim.motion.strikes import LIMBS
from crowdsim.places.mesh import flat_mesh
from crowdsim.poses.builds import joint_segments
from crowdsim.poses.down_state import fallen_rows
from crowdsim.poses.sampler import PoseSampler
from crowdsim.render.crowd_path import watch
from crowdsim.render.take_source import TakeSource
from crowdsim.scenario.camera import Camera
from crowdsim.scenario.frame_ranges import parse_frames
from crowdsim.scenario.heals import Heal, find_returns
from crowdsim.take.take import Take
from crowdsim.view.obstacle_frames import obstacle_frames
from crowdsim.view.recording import OUTSIDE, Recording, describe_figure, pack_paints, plan_cameras

_COARSENESS = 1.4
"""How many times as long as usual the edges of skins are."""
_POSES_AT_ONCE = 16_000
_ROWS_AT_ONCE = 4_000_000


def record_take(
    take: Take,
    fps: float,
    avatars: Sequence[int] | None = None,
    frames: str | None = None,
    threads: int = 1,
    arena: Array | None = None,
    cameras: Mapping[str, Camera] | None = None,
    health: Mapping[str, float] | None = None,
    obstacles: Array | None = None,
    heals: Sequence[Heal] = (),
) -> Recording:
    """Return a take for the player.

    Args:
        take: The take, with its policies.
        fps: Frames a second.
        avatars: Numbers of the avatars, ascending; all when None.
        frames: Output frames ``A:B``, in frames or seconds; all when None.
        threads: Threads that pose.
        arena: The arena of its scenario, see ``crowd.cast.pack_arena``; open ground when None.
        cameras: Cameras of its scenario by name.
        health: Health of avatars at the start, by the names of their types; those without cannot be hurt [points].
        obstacles: Parts of obstacles, see ``RecordedRun.obstacles``; none when None.
        heals: When health is restored beside that of those that come back.

    Raises:
        TakeError: The take has no such frames, or none of the avatars is there in them.
    """
    count = take.output_frames(fps)
    first, stop = (0, count) if frames is None else parse_frames(frames).resolve(count, fps)
    with ThreadPoolExecutor(1) as pool:
        if threads > 1:
            # Skins are made while poses are being prepared; they are kept, and found when they are described.
            pool.submit(_prepare_skins, take, range(take.avatar_count) if avatars is None else avatars)
        motion = TakeMotion(take, fps, avatars, first, stop, threads, health or {}, heals)
    sampler = motion.sampler
    source = TakeSource(take, take.policies, fps, threads=threads, arena=arena, cameras=cameras, sampler=sampler)
    crowd = watch(source)
    if avatars is not None:
        things = np.arange(crowd.avatars, crowd.grounds.shape[1])
        shown = np.concatenate([motion.numbers, things])
        crowd = replace(
            crowd, avatars=len(motion.numbers), grounds=crowd.grounds[:, shown], heights=crowd.heights[shown]
        )
    tracks, sun = plan_cameras(source, crowd, first, stop - first, avatars is None)
    motion.scene = {
        "arena": np.asarray(source.arena, float).tolist(),
        "sun": [round(float(value), 5) for value in sun],
        "obstacles": [] if obstacles is None else obstacle_frames(obstacles),
    }
    motion.heights = source.avatar_heights[motion.numbers]
    return Recording(motion, take.scenario, tracks)


def _prepare_skins(take: Take, avatars: Sequence[int]) -> None:
    for policy, build in {(int(take.cast.policies[avatar]), build_of(take.cast, avatar)) for avatar in avatars}:
        build_skin_of(take.policies[policy].database, build, _COARSENESS)


def _describe_skin(skin: Skin, number: int) -> dict[str, Any]:
    """Return of a skin where each part's triangles end, its helpers, and how it grows."""
    return {
        "number": number,
        "ends": np.searchsorted(skin.parts, np.arange(len(SKIN_PARTS)), side="right").tolist(),
        "helpers": skin.helpers.tolist(),
        "straights": [round(float(value), 6) for value in skin.straights().ravel()],
        "thickens": skin.thickens.astype(int).tolist(),
        "girth": skin.girth,
    }


def _skin_tables(skin: Skin, number: int) -> dict[str, Array]:
    """Return the mesh of a skin: vertices [m], normals and weights as bytes, joints, triangles, and what grows it."""
    weights = np.rint(255.0 * skin.weights)
    rows = np.arange(len(weights))
    # They add up to one, or the skin would go towards the origin.
    weights[rows, weights.argmax(axis=1)] += 255.0 - weights.sum(axis=1)
    return {
        f"skin_{number}_vertices": np.round(skin.vertices, 4).astype(np.float32),
        f"skin_{number}_normals": np.rint(127.0 * skin.normals + 128.0).astype(np.uint8),
        f"skin_{number}_joints": skin.joints.astype(np.uint8),
        f"skin_{number}_weights": weights.astype(np.uint8),
        f"skin_{number}_triangles": skin.triangles.astype(np.int32),
        f"skin_{number}_bindings": skin.inverse_bindings().astype(np.float32),
        f"skin_{number}_axes": skin.axes.astype(np.float32),
    }


class TakeMotion:
    """Motion of some avatars of a take; a ``recording.Motion``.

    Attributes:
        sampler: Poses the take.
        numbers: Numbers of the avatars in the take, ascending. Shape (n,).
        scene: Arena, and direction to the sun.
        heights: Standing height of each avatar [m]. Shape (n,).
    """

    def __init__(
        self,
        take: Take,
        fps: float,
        avatars: Sequence[int] | None,
        first: int,
        stop: int,
        threads: int,
        health: Mapping[str, float],
        heals: Sequence[Heal] = (),
    ) -> None:
        self.fps, self.first, self.frames = fps, first, stop - first
        self.scene: dict[str, Any] = {}
        self.sampler = PoseSampler(take, take.policies, threads)
        self.take = replace(take, **{name: getattr(self.sampler.take, name) for name in ("action", "opponent")})
        self._health, self._heals = health, heals
        chosen = np.arange(take.avatar_count) if avatars is None else np.asarray(avatars, np.int64)
        present = self._presence(chosen)
        self.numbers = chosen[np.isin(np.arange(len(chosen)), present[:, 0])]
        if not len(self.numbers):
            raise TakeError(f"{take.scenario}: none of these avatars is there in frames {first}:{stop}")
        self._present = present
        self._present[:, 0] = np.searchsorted(self.numbers, chosen[present[:, 0]])
        self.avatars = len(self.numbers)
        self.heights = np.zeros(self.avatars)
        policies, held = take.cast.policies[self.numbers], take.cast.held
        self._policies = np.unique(policies)
        self._figures = []
        for index in self._policies:
            database = take.policies[index].database
            segments = joint_segments(database.skeleton, database.body)
            own = held[np.isin(held["type"], take.cast.types[self.numbers[policies == index]])]
            self._figures.append(
                describe_figure(database.skeleton, database.body, segments, [0], skinned=True, held=own)
            )
        self.bits = [np.array(figure["bits"]) for figure in self._figures]

    def poses(self, start: int, stop: int) -> list[tuple[Array, Array]]:
        """Return poses of frames ``start`` to ``stop``, counted from the first."""
        size = max(1, _POSES_AT_ONCE // self.avatars)
        parts = [
            self.sampler.sample(self.first + low, self.first + min(low + size, stop), self.fps, self.numbers)
            for low in range(start, stop, size)
        ]
        return [
            (
                np.concatenate([one.root_positions for one in figure])[:, :, None],
                np.concatenate([one.rotations for one in figure]),
            )
            for figure in zip(*parts, strict=True)
        ]

    def describe(self) -> tuple[dict[str, Any], dict[str, Array]]:
        """Return what the player shows beside motion."""
        take, cast, numbers = self.take, self.take.cast, self.numbers
        teams = np.asarray(cast.teams, int)
        paints = avatar_paints(teams, np.asarray(cast.colours, float)[cast.types])[numbers]
        looks = np.stack([
            skin_paints(*one) for one in zip(numbers.tolist(), paints, cast.types[numbers].tolist(), strict=True)
        ])  # fmt: skip
        full = np.array([self._health.get(name, 0.0) for name in cast.type_names], np.float32)[cast.types[numbers]]
        _, order = np.unique(teams, return_inverse=True)
        colours = {int(team): team_colour(int(at)) for team, at in zip(teams, order, strict=True)}
        document = {
            "kind": "run",
            **self.scene,
            "rate": take.control_rate,
            "seed": take.seed,
            "names": cast.names[numbers].tolist(),
            "numbers": numbers.tolist(),
            "teams": list(cast.team_names),
            "team_colours": [
                [round(255 * value) for value in colours.get(team, (0.5, 0.5, 0.5))]
                for team in range(len(cast.team_names))
            ],
            "types": list(cast.type_names),
            "figures": self._figures,
            "limbs": list(LIMBS),
            "outcomes": list(OUTCOMES),
            "targets": list(take.target_names),
            "props": self._props(),
            "faces": self._faces(),
        }
        tables = {
            "figure": np.searchsorted(self._policies, cast.policies[numbers]).astype(np.int32),
            "team": teams[numbers].astype(np.int32),
            "type": cast.types[numbers].astype(np.int32),
            "scale": cast.scales[numbers],
            "girth": cast.girths[numbers],
            "stretch": cast.stretches[numbers].astype(np.float32),
            "speed": cast.speeds[numbers],
            "height": self.heights.astype(np.float32),
            "paint": pack_paints(self._capsule_paints(paints, looks)),
            "skin_paint": pack_paints(looks),
            "present": self._present.astype(np.int32),
            **self._strikes(full),
            **self._falls(),
            **self._skins(),
            **self._opponents(),
        }
        actions, clips = self._actions()
        tables |= actions
        if take.target_names:
            tables["target"] = np.asarray(take.targets[:], np.float32)
        return {**document, "clips": clips}, tables

    def _props(self) -> list[dict[str, Any]]:
        """Return the capsules that avatars carry, by the numbers of their types; ``mesh`` marks rods on faces."""
        solid = len(self.take.cast.attachments)
        return [
            {
                "type": int(row["type"]),
                "joint": int(row["joint"]),
                "start": [round(float(value), 4) for value in row["start"]],
                "end": [round(float(value), 4) for value in row["end"]],
                "radius": round(float(row["radius"]), 4),
                "colour": [round(float(value), 4) for value in row["colour"]],
                "mesh": number >= solid,
            }
            for number, row in enumerate(self.take.cast.held)
        ]

    def _faces(self) -> list[dict[str, Any]]:
        """Return the triangles of meshes that avatars carry, those of a type, joint and colour together."""
        faces, found = self.take.cast.faces, []
        keys = np.concatenate([faces["type"][:, None], faces["joint"][:, None], faces["colour"]], axis=1)
        kinds, own = np.unique(keys, axis=0, return_inverse=True)
        own = own.reshape(-1)
        for key, mine in zip(
            kinds, np.split(np.argsort(own, kind="stable"), np.cumsum(np.bincount(own))), strict=False
        ):
            mesh = flat_mesh(faces["corners"][mine])
            found.append({
                "type": int(key[0]),
                "joint": int(key[1]),
                "places": mesh.positions.round(4).ravel().tolist(),
                "normals": mesh.normals.round(3).ravel().tolist(),
                "colour": [round(float(value), 4) for value in key[2:]],
            })  # fmt: skip
        return found

    def _skins(self) -> dict[str, Array]:
        """Return meshes of skins, one for each build, and which of its figure's ``skins`` each avatar has."""
        cast, tables, number = self.take.cast, dict[str, Array](), 0
        which = np.zeros(self.avatars, np.int32)
        for policy, figure in zip(self._policies.tolist(), self._figures, strict=True):
            builds = dict[Build, int]()
            figure["skins"] = []
            for column in np.flatnonzero(cast.policies[self.numbers] == policy).tolist():
                build = build_of(cast, int(self.numbers[column]))
                if build not in builds:
                    skin = build_skin_of(self.take.policies[policy].database, build, _COARSENESS)
                    builds[build] = len(builds)
                    figure["skins"].append(_describe_skin(skin, number))
                    tables |= _skin_tables(skin, number)
                    number += 1
                which[column] = builds[build]
        return {**tables, "bone_skin": which}

    def _capsule_paints(self, paints: Array, looks: Array) -> Array:
        """Return paints of capsules, like those of the skins for which they stand from afar. Shape (n, 8, 4)."""
        cast, numbers = self.take.cast, self.numbers
        worn = capsule_paints(paints, cast.bare[numbers])
        chests = np.array([sex == "male" for sex, _ in cast.bodies])[cast.types[numbers]]
        worn[chests, PARTS.index("shirt")] = paints[chests, PARTS.index("skin")]
        return np.concatenate([worn, looks[:, [SKIN_PARTS.index("hair")]]], axis=1)

    def _control(self) -> tuple[int, int]:
        """Return the first control frame that is recorded, and one past the last."""
        ends = self.sampler.control_frames(np.array([self.first, self.first + self.frames - 1]), self.fps)
        return int(ends[0]), int(ends[1]) + 1

    def _presence(self, chosen: Array) -> Array:
        """Return for each stretch in which an avatar is there its column, first frame, and one past the last."""
        begin, end = self._control()
        there = np.concatenate(
            [
                np.asarray(self.take.action[low : min(low + self._rows(), end)])[:, chosen] >= 0
                for low in range(begin, end, self._rows())
            ]
        )
        edges = np.diff(np.pad(there, ((1, 1), (0, 0))).astype(np.int8), axis=0)
        column, start = np.nonzero(edges.T > 0)
        _, stop = np.nonzero(edges.T < 0)
        per_control = self.fps / self.take.control_rate
        frames = [
            np.clip(np.ceil((begin + at - 1e-9) * per_control) - self.first, 0, self.frames) for at in (start, stop)
        ]
        frames[1][stop == end - begin] = self.frames
        return np.stack([column, *frames], axis=1).astype(np.int64)

    def _rows(self) -> int:
        return max(1, _ROWS_AT_ONCE // max(1, self.take.avatar_count))

    def _changes(self, names: Sequence[str]) -> tuple[Array, Array, list[Array]]:
        """Return where recorded variables of avatars change: CSR offsets (n + 1,), control frames, and their values.

        The first variable is compared; with ``action_frame`` among them, an action that starts again is a change.
        """
        begin, end = self._control()
        found: list[tuple[Array, Array, list[Array]]] = []
        before: list[Array] = []
        speeds = self.take.cast.speeds[self.numbers]
        for low in range(begin, end, self._rows()):
            high = min(low + self._rows(), end)
            values = [np.asarray(getattr(self.take, name)[low:high])[:, self.numbers] for name in names]
            last = before or [value[:1] for value in values]
            rows = [np.concatenate([one, value]) for one, value in zip(last, values, strict=True)]
            changed = rows[0][1:] != rows[0][:-1]
            if len(names) > 1:
                changed |= rows[1][1:] < rows[1][:-1] + 0.5 * speeds
            if not before:
                changed[0] = True
            column, row = np.nonzero(changed.T)
            found.append((column, row + low, [value[row, column] for value in values]))
            before = [value[-1:] for value in values]
        columns, frames = (np.concatenate([part[i] for part in found]) for i in (0, 1))
        order = np.lexsort([frames, columns])
        offsets = np.searchsorted(columns[order], np.arange(self.avatars + 1))
        more = [np.concatenate([part[2][i] for part in found])[order] for i in range(len(names))]
        return offsets.astype(np.int32), frames[order].astype(np.int32), more

    def _actions(self) -> tuple[dict[str, Array], list[str]]:
        """Return what each avatar does from when on, and the names of the clips that actions are captured in."""
        offsets, frames, (actions, phases) = self._changes(["action", "action_frame"])
        policies = np.repeat(self.take.cast.policies[self.numbers], np.diff(offsets)).astype(np.int64)
        pairs, index = np.unique(np.stack([policies, actions]), axis=1, return_inverse=True)
        clips: dict[tuple[int, int], int] = {}
        names: list[str] = []
        rows = np.zeros((pairs.shape[1], 4), np.float32)
        for row, (policy, action) in enumerate(pairs.T.tolist()):
            if action < 0:
                rows[row] = -1.0, -1.0, 0.0, 0.0
                continue
            database = self.take.policies[policy].database
            first = int(self.take.policies[policy].graph.action_first[action]) - 1
            clip = int(np.searchsorted(database.clip_starts, first, side="right")) - 1
            if (policy, clip) not in clips:
                clips[policy, clip] = len(names)
                names.append(str(database.clip_names[clip]))
            start = (first - int(database.clip_starts[clip])) * database.stride
            rows[row] = action, clips[policy, clip], start, database.stride
        return {
            "action_offset": offsets,
            "action_frame": frames,
            "action_row": index.reshape(-1).astype(np.int32),
            "action_phase": phases.astype(np.float32),
            "action_table": rows,
        }, names

    def _opponents(self) -> dict[str, Array]:
        offsets, frames, (opponents,) = self._changes(["opponent"])
        return {
            "opponent_offset": offsets,
            "opponent_frame": frames,
            "opponent": self._indices(opponents),
        }

    def _indices(self, avatars: Array) -> Array:
        """Return places of avatars (k,) among those that are recorded; negative numbers stay."""
        avatars = np.asarray(avatars, np.int64)
        at = np.minimum(np.searchsorted(self.numbers, avatars), self.avatars - 1)
        known = np.where(self.numbers[at] == avatars, at, OUTSIDE)
        return np.where(avatars < 0, avatars, known).astype(np.int32)

    def _strikes(self, full: Array) -> dict[str, Array]:
        """Return the strikes of these frames and avatars in the order of time, and what health avatars begin with."""
        events, rate = self.take.events, self.take.control_rate
        times = np.asarray(events.frame, float) / rate
        begin, end = self.first / self.fps, (self.first + self.frames) / self.fps
        attackers, victims = (self._indices(part) for part in (events.attacker, events.victim))
        damage = np.asarray(events.damage, np.float32)
        hurt = np.intersect1d(self.numbers[full > 0.0], np.asarray(events.victim)[damage > 0.0]).tolist()
        healed = [
            (one.seconds, avatar)
            for one in sorted([*self._heals, *find_returns(self.take.action, hurt, rate)])
            for avatar in np.flatnonzero((self.numbers >= one.first) & (self.numbers < one.stop)).tolist()
        ]
        since = np.zeros(self.avatars)
        for seconds, avatar in healed:
            since[avatar] = seconds if seconds < begin else since[avatar]
        spent = np.zeros(self.avatars, np.float32)
        earlier = (times < begin) & (victims >= 0) & (times > since[np.maximum(victims, 0)])
        np.add.at(spent, victims[earlier], damage[earlier])
        restored = [one for one in healed if begin <= one[0] < end]
        kept = np.flatnonzero((times >= begin) & (times < end) & ((attackers >= 0) | (victims >= 0)))
        kept = kept[np.argsort(times[kept], kind="stable")]
        return {
            "health": np.stack([full, np.maximum(full - spent, 0.0)], axis=1),
            **self._restored(restored),
            "strike_time": times[kept].astype(np.float32),
            "strike_attacker": attackers[kept],
            "strike_victim": victims[kept],
            "strike_limb": np.asarray(events.limb, np.uint8)[kept],
            "strike_outcome": np.asarray(events.outcome, np.uint8)[kept],
            "strike_down": np.asarray(events.down, np.uint8)[kept],
            "strike_point": np.asarray(events.point, np.float32).reshape(-1, 3)[kept],
            "strike_speed": np.asarray(events.speed, np.float32)[kept],
            "strike_damage": damage[kept],
        }

    def _restored(self, healed: Sequence[tuple[float, int]]) -> dict[str, Array]:
        """Return when health is restored to which avatars, in the order of time; nothing where it never is."""
        if not healed:
            return {}
        return {
            "heal_time": np.array([seconds for seconds, _ in healed], np.float32),
            "heal_avatar": np.array([avatar for _, avatar in healed], np.int32),
        }

    def _falls(self) -> dict[str, Array]:
        """Return when avatars are down: who, from and until [s], in the order of time."""
        begin, end = self._control()
        rows = max(1, _ROWS_AT_ONCE // self.avatars)
        down = np.concatenate(
            [
                fallen_rows(self.sampler.take, self.sampler.motions, low, min(low + rows, end), self.numbers)
                for low in range(begin, end, rows)
            ]
        )
        edges = np.diff(np.pad(down, ((1, 1), (0, 0))).astype(np.int8), axis=0)
        column, start = np.nonzero(edges.T > 0)
        _, stop = np.nonzero(edges.T < 0)
        order = np.lexsort([column, start])
        times = (np.stack([start, stop], axis=1)[order] + begin) / self.take.control_rate
        return {"down_avatar": column[order].astype(np.int32), "down_time": times.astype(np.float32)}
