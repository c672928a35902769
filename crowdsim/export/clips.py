"""A take as a bank of clips and a track for each avatar, for engines that play thousands of avatars.

The bank is one ``.glb`` of a skinned body for each policy, with the clips that the take plays as animations: only what
is played of them, each once, in place, which is as seen from the ground transform. A track says which clip an avatar
plays from when on, how long clips blend, and where its ground transform is at every output frame. Layers that let
bodies meet one another and the floor are left out.
"""

from __future__ import annotations

import json
import os
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowdsim.body.anatomy import Build
from crowdsim.body.palette import avatar_paints, skin_paints
from crowdsim.body.skin import build_skin_of
from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.errors import OutputError
from crowdsim.export.gltf import Document, GltfFile, key_times, moving_joints, packed_rotations, stored_rotations
from crowdsim.export.prop_meshes import PropMesh, prop_meshes
from crowdsim.export.stream import Block
from crowdsim.poses.kernels.blending import BLEND, blend_poses
from crowdsim.poses.kernels.records import Moments, Posed
from crowdsim.poses.layers.blend import Blend
from crowdsim.poses.sampler import PoseSampler
from crowdsim.scenario.rates import exact_rate, rate_text

VERSION = 1
"""Of the tracks."""
BANK, TRACKS, PARQUET = "bank.glb", "tracks.json", "tracks.parquet"
_AT_ONCE = 256
"""Avatars whose tracks are worked out at once."""
_STRAY, _TALL = 0.004, 1.8
"""How far a straight line may stray from the ground transform [m], at the far end of a body so long [m]."""
_QUARTERS = np.array([[0.25], [0.5], [0.75]])
_FINEST = 1e-3
"""Shares of a stretch of time where it is compared with a straight line, and how short the shortest is [frames]."""


def clip_files() -> list[str]:
    """Return the names of the files: tracks come as Parquet too where pyarrow is installed."""
    return [BANK, TRACKS] + [PARQUET] * (find_spec("pyarrow") is not None)


class Segment(NamedTuple):
    """Motion that an avatar plays as captured, until the next segment.

    Attributes:
        frame: Playback frame with which it begins.
        start: When, from the first output frame on [s].
        before: How long before that the blend from the segment before begins [s].
        after: How long after it the blend lasts [s].
        stop: When the next segment begins, or the avatar leaves [s].
    """

    frame: float
    start: float
    before: float
    after: float
    stop: float


class ClipSink:
    """Writes a bank of clips and tracks; a ``Sink`` that poses avatars itself, without layers of contacts.

    Args:
        sampler: Poses of the take.
        folder: Folder of the files, which is there when the first is written.
        fps: Output frames a second, at which tracks say where avatars are.
        frames: First output frame and one past the last; all when None.
        avatars: Numbers of the avatars; all when None.
        rotations: ``float32``, or ``int16``, which takes half the place.
    """

    kind, reads_joints, margin = "clips", False, 0

    def __init__(
        self,
        sampler: PoseSampler,
        folder: Path,
        fps: float | Fraction,
        frames: tuple[int, int] | None = None,
        avatars: Sequence[int] | Array | None = None,
        rotations: str = "float32",
    ) -> None:
        take = sampler.take
        self.start, self.stop = frames or (0, take.output_frames(float(fps)))
        self.avatars: Array = np.zeros(0, np.int64)  # blocks need no poses
        self._numbers: Array = np.arange(take.avatar_count) if avatars is None else np.unique(np.asarray(avatars))
        self._sampler, self._folder, self._fps, self._rotations = sampler, folder, exact_rate(fps), rotations
        # x, height by which longer legs lift the body, z, heading.
        self._roots = np.full((self.stop - self.start, len(self._numbers), 4), np.nan, np.float32)
        # Column, frame, and the ground transform as above.
        self._between = [np.zeros((0, 6))]
        self._rows = 0

    @property
    def total(self) -> int:
        """Number of files."""
        return len(clip_files())

    @property
    def done(self) -> int:
        """Their share that is worked out so far."""
        return self.total * self._rows // (self.stop - self.start)

    def split(self, most: int) -> list[ClipSink]:
        """Return itself: there is one bank."""
        return [self]

    def write(self, block: Block, pool: ThreadPoolExecutor) -> None:
        """Work out where avatars are in a block of frames."""
        low, high = max(block.first_output, self.start), min(block.stop_output, self.stop)
        # What lies between the last frame of the block and the next belongs to it.
        last = min(high, self.stop - 1)
        frames = np.arange(low, last + 1)
        for policy, some in self._groups():
            ground = self._ground(policy, self._numbers[some], frames[:, None] / float(self._fps))
            self._roots[low - self.start : high - self.start, some] = ground[: high - low]
            self._between += self._strays(policy, some, frames, ground)
        self._rows = high - self.start

    def _strays(self, policy: int, columns: Array, frames: Array, ground: Array) -> list[Array]:
        """Return the ground transforms between frames where straight lines stray from them. Shapes (n, 6).

        Stretches that stray are divided into quarters, and these again.

        Args:
            policy: Number of the policy.
            columns: Columns of its avatars.
            frames: Output frames. Shape (T,).
            ground: Ground transforms at these. Shape (T, n, 4).
        """
        if len(frames) == 1:
            return []
        tall = _TALL * self._sampler.take.cast.scales[self._numbers[columns]]
        own = np.tile(np.arange(len(columns)), len(frames) - 1)
        begins, width = np.repeat(frames[:-1].astype(float), len(columns)), 1.0
        ends = np.stack([ground[:-1], ground[1:]], axis=2).reshape(-1, 2, 4)
        between = (frames[:-1] + _QUARTERS).T.reshape(-1, 1) / float(self._fps)
        quarters = self._ground(policy, self._numbers[columns], between).reshape(-1, 3, len(columns), 4)
        inner, found = np.swapaxes(quarters, 1, 2).reshape(-1, 3, 4), []
        while True:
            places = begins[:, None] + width * _QUARTERS[:, 0]
            ways = ends[:, 1] - ends[:, 0]
            ways[:, 3] = _turn(ways[:, 3])
            stray = np.abs(inner - ends[:, :1] - _QUARTERS * ways[:, None])
            stray[..., 3] = np.abs(_turn(stray[..., 3]))
            gap = np.hypot(stray[..., 0], stray[..., 2]) + stray[..., 1] + tall[own, None] * stray[..., 3]
            far = gap.max(axis=1) > _STRAY
            inner, places, own, begins, ends = inner[far], places[far], own[far], begins[far], ends[far]
            rows = np.broadcast_to(columns[own][:, None], places.shape), places - self.start
            found.append(np.concatenate([np.stack(rows, axis=-1), inner], axis=-1).reshape(-1, 6))
            nodes = np.concatenate([ends[:, :1], inner, ends[:, 1:]], axis=1)
            ends = np.stack([nodes[:, :-1], nodes[:, 1:]], axis=2).reshape(-1, 2, 4)
            begins = np.concatenate([begins[:, None], places], axis=1).ravel()
            own, width = np.repeat(own, 4), width / 4
            if not len(own) or width <= _FINEST:
                return found
            inner = self._ground_at(policy, self._numbers[columns], own, begins[:, None] + width * _QUARTERS[:, 0])

    def _ground_at(self, policy: int, avatars: Array, own: Array, places: Array) -> Array:
        """Return ground transforms of some avatars, each at times of its own. Shape (n, 3, 4).

        Args:
            policy: Number of the policy.
            avatars: Its avatars.
            own: Which of them. Shape (n,).
            places: Output frames. Shape (n, 3).
        """
        count = np.bincount(own, minlength=len(avatars))
        order = np.lexsort([places[:, 0], own])
        rows = np.empty(len(own), np.int64)
        rows[order] = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
        times = np.full((int(count.max()), 3, len(avatars)), np.nan)
        times[rows, :, own] = places
        # Avatars with fewer times than others stay at the last of theirs.
        times[0, 0, count == 0] = places.min()
        ascending = np.fmax.accumulate(times.reshape(-1, len(avatars)))
        ground = self._ground(policy, avatars, ascending / float(self._fps))
        return ground.reshape(-1, 3, len(avatars), 4)[rows, :, own]

    def close(self) -> list[Path]:
        """Write the files and return them."""
        segments = {
            int(number): found
            for policy, some in self._groups()
            for number, found in zip(self._numbers[some], self._segments(policy, self._numbers[some]), strict=True)
        }
        clips = self._used_clips(segments)
        file = GltfFile(self._folder / BANK, self._bank(clips))
        try:
            file.begin()
            written = file.close()
        except BaseException:
            file.abandon()
            raise
        head = self._head(clips)
        write_tracks = [(TRACKS, self._write_json), (PARQUET, self._write_parquet)]
        for name, write in write_tracks[: len(clip_files()) - 1]:
            path = self._folder / name
            partial = path.with_name(f".{name}.{uuid.uuid4().hex}.part")
            try:
                write(partial, head, lambda: self._tracks(segments, clips))
                os.replace(partial, path)
            except OSError as error:
                raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
            finally:
                partial.unlink(missing_ok=True)
            written.append(path)
        return written

    def abandon(self) -> None:
        """Do nothing: no file is begun before all is known."""

    def _groups(self) -> Iterator[tuple[int, Array]]:
        """Yield policies and some of their avatars, as indices."""
        owners = self._sampler.take.cast.policies[self._numbers]
        for policy in np.unique(owners):
            mine = np.flatnonzero(owners == policy)
            for low in range(0, len(mine), _AT_ONCE):
                yield int(policy), mine[low : low + _AT_ONCE]

    def _ground(self, policy: int, avatars: Array, times: Array) -> Array:
        """Return ground transforms with their blends: x, lift and z [m], and heading [rad]. Shape (T, n, 4).

        Args:
            policy: Number of the policy.
            avatars: Its avatars. Shape (n,).
            times: Ascending [s]. Shape (T, n), or (T, 1) where they are the same for all.
        """
        moments = Moments(np.arange(len(avatars)), times)
        part = self._sampler.poser.part(policy, avatars, moments, Blend.name)
        motion, transitions = part.window.motion, part.window.transitions
        # The root of a body of one joint that never moves is its ground transform.
        still = np.zeros((len(motion.frames.rotations), 1, 4), np.float32)
        still[..., 0] = 1.0
        frames = motion.frames._replace(rotations=still, roots=np.zeros_like(motion.frames.roots))
        signs = np.ones((len(transitions.times), 2), np.int8)
        signs[:, -1] = 0
        hinges = motion.hinges._replace(**{name: values[:0] for name, values in motion.hinges._asdict().items()})
        shape = len(times), len(avatars)
        poses = Posed(np.empty((*shape, 3), np.float32), np.empty((*shape, 1, 4), np.float32))
        share(len(avatars), blend_poses, moments, part.playback, part.window.rows, frames,
              transitions._replace(signs=signs), hinges, poses)  # fmt: skip
        headings = 2.0 * np.arctan2(poses.rotations[..., 0, 2], poses.rotations[..., 0, 0])
        return np.concatenate([poses.roots, headings[..., None]], axis=-1)

    def _segments(self, policy: int, avatars: Array) -> list[list[Segment]]:
        """Return the segments of avatars of a policy."""
        fps, rate = float(self._fps), self._sampler.take.control_rate
        begin, end = self.start / fps, (self.stop - 1) / fps
        window = self._sampler.poser.window(policy, avatars, np.array([begin, end]), BLEND)
        rows, transitions, stride = window.rows, window.transitions, window.motion.frames.stride
        found = []
        for column in range(len(avatars)):
            present = np.concatenate([[False], rows.present[:, column], [False]])
            comes, leaves = (np.flatnonzero(present[1:] & ~present[:-1]), np.flatnonzero(present[:-1] & ~present[1:]))
            mine = slice(transitions.starts[column], transitions.starts[column + 1])
            segments: list[Segment] = []
            for first, stop in zip(comes, leaves, strict=True):
                since, until = (rows.first + first) / rate, (rows.first + stop) / rate
                frame = rows.origins[first, column] + rows.phase[first, column] * stride
                own = [(float(frame), since, 0.0, 0.0)]
                for time, after, (ahead, behind) in zip(
                    transitions.times[mine], transitions.after[mine], transitions.spans[mine], strict=True
                ):
                    if since < time < until:
                        own.append((float(after), float(time), float(ahead), float(behind)))
                stops = [time for _, time, _, _ in own[1:]] + [until]
                # Of those that are over before the first output frame, or begin after the last, none is seen.
                segments += [
                    Segment(frame, time - begin, ahead, behind, stop - begin)
                    for (frame, time, ahead, behind), stop in zip(own, stops, strict=True)
                    if stop + BLEND >= begin and time - BLEND <= end
                ]
            found.append(segments)
        return found

    def _used_clips(self, segments: dict[int, list[Segment]]) -> dict[int, Array]:
        """Return the stretches of playback frames that avatars of each policy play, first and last. Shape (n, 2)."""
        cast, used = self._sampler.take.cast, {}
        for number, own in segments.items():
            policy = int(cast.policies[number])
            frames = self._sampler.motions[policy].frames
            if policy not in used:
                used[policy] = np.zeros(len(frames.rotations), bool)
            pace = float(cast.speeds[number]) * frames.rate
            for segment, after in zip(own, [*own[1:], None], strict=True):
                first, last = frames.bounds[int(segment.frame)]
                tail = after.after if after is not None and after.before + after.after > 0.0 else 0.0
                low = segment.frame - pace * segment.before - 1
                high = segment.frame + pace * (segment.stop - segment.start + tail) + 2
                used[policy][max(int(low), first) : min(int(high), last) + 1] = True
        found = {}
        for policy, mask in used.items():
            bounds = self._sampler.motions[policy].frames.bounds
            cuts = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
            stretches = []
            for low, high in zip(cuts[::2], cuts[1::2] - 1, strict=True):
                # A stretch ends where its clip does.
                ends = [low, *(np.flatnonzero(np.diff(bounds[low : high + 1, 0])) + low + 1), high + 1]
                stretches += [(one, other - 1) for one, other in pairwise(ends)]
            found[policy] = np.array(stretches, np.int64).reshape(-1, 2)
        return found

    def _bank(self, clips: dict[int, Array]) -> Document:
        """Lay out the bank."""
        document, sampler = Document(), self._sampler
        paints = skin_paints(0, avatar_paints([0])[0])
        animations, moments = list[dict[str, Any]](), dict[tuple[int, float], int]()
        for policy, stretches in clips.items():
            database, motion = sampler.policies[policy].database, sampler.motions[policy]
            added = document.add_skin(build_skin_of(database, Build()))
            moving, still = moving_joints(database)
            rest = np.where(moving[:, None], np.nan, still)
            name = str(sampler.take.cast.policy_names[policy])
            first = document.add_body(name, database.skeleton, added, rest, paints, 1.0, {"policy": name})
            props = list(self._props(policy))
            for node, kind, prop in props:
                document.add_prop(node, first + 1 + prop.joint, prop, {"type": kind})
            tracks = stored_rotations(added.skin, moving, [prop.joint for _, _, prop in props], self._rotations)
            for low, high in stretches:
                span = slice(low, high + 1)
                key = int(high + 1 - low), motion.frames.rate
                if key not in moments:
                    times = key_times(np.arange(key[0]), exact_rate(motion.frames.rate))
                    moments[key] = document.add(times, limits=True)
                local = motion.frames.rotations[span]
                keys = [(first + 1, "translation", document.add(motion.frames.roots[span].astype("<f4")))]
                for joints, dtype in tracks:
                    last = np.tile([1.0, 0.0, 0.0, 0.0], (len(joints), 1))
                    packed = packed_rotations(added.skin, local, joints, dtype, last)
                    for joint, values in zip(joints.tolist(), packed, strict=True):
                        keys.append((first + 1 + joint, "rotation", document.add(values)))
                animations.append({
                    "name": f"{name}/{len(animations)}",
                    "samplers": [{"input": moments[key], "output": output} for _, _, output in keys],
                    "channels": [
                        {"sampler": number, "target": {"node": node, "path": path}}
                        for number, (node, path, _) in enumerate(keys)
                    ],
                })  # fmt: skip
        document.json["animations"] = animations
        document.json["scenes"][0]["name"] = str(sampler.take.scenario)
        return document

    def _props(self, policy: int) -> Iterator[tuple[str, str, PropMesh]]:
        """Yield what avatars of a policy carry: the name of its node, their type, and the prop."""
        cast, names = self._sampler.take.cast, self._sampler.motions[policy].skeleton.names
        for number in np.unique(cast.types[self._numbers][cast.policies[self._numbers] == policy]).tolist():
            kind = str(cast.type_names[number])
            for prop in prop_meshes(cast, number):
                yield f"{kind} {names[prop.joint]} prop", kind, prop

    def _head(self, clips: dict[int, Array]) -> dict[str, Any]:
        """Return what tracks have in common."""
        sampler, head = self._sampler, []
        for skeleton, (policy, stretches) in enumerate(clips.items()):
            database, frames = sampler.policies[policy].database, sampler.motions[policy].frames
            starts = np.asarray(database.clip_starts) * frames.stride
            for low, high in stretches:
                clip = int(np.searchsorted(starts, low, side="right")) - 1
                head.append({
                    "skeleton": skeleton, "frames": int(high + 1 - low), "rate": frames.rate,
                    "of": database.clip_names[clip], "first": int(low - starts[clip]),
                })  # fmt: skip
        skeletons: list[dict[str, Any]] = [
            {
                "name": str(sampler.take.cast.policy_names[policy]),
                "joints": list(sampler.motions[policy].skeleton.names),
                "parents": np.asarray(sampler.motions[policy].skeleton.parents).tolist(),
                "sizes": sampler.motions[policy].segments.tolist(),
            }
            for policy in clips
        ]
        for keys, policy in zip(skeletons, clips, strict=True):
            props = [{"node": node, "joint": prop.joint, "type": kind} for node, kind, prop in self._props(policy)]
            if props:
                keys["props"] = props
        return {
            "version": VERSION, "units": "metres, seconds, radians, y up", "bank": BANK,
            "scenario": str(sampler.take.scenario), "fps": rate_text(float(self._fps)), "first_frame": self.start,
            "frames": self.stop - self.start, "skeletons": skeletons, "clips": head,
        }  # fmt: skip

    def _tracks(self, segments: dict[int, list[Segment]], clips: dict[int, Array]) -> Iterator[dict[str, Any]]:
        """Yield the tracks of the avatars that are there."""
        cast = self._sampler.take.cast
        before = dict(zip(clips, np.cumsum([0, *map(len, clips.values())]), strict=False))
        between = np.concatenate(self._between)
        between = between[np.lexsort(between[:, 1::-1].T)]
        own = np.searchsorted(between[:, 0], np.arange(len(self._numbers) + 1))
        for column, number in enumerate(self._numbers.tolist()):
            roots = self._roots[:, column].astype(float)
            there = np.flatnonzero(np.isfinite(roots[:, 0]))
            if not len(there):
                continue
            roots[there, 3] = np.unwrap(roots[there, 3])
            more = between[own[column] : own[column + 1], 1:]
            headings = roots[more[:, 0].astype(int), 3]
            more[:, 4] = headings + _turn(more[:, 4] - headings)
            more[:, 0] -= there[0]
            policy = int(cast.policies[number])
            stretches, rate = clips[policy], self._sampler.motions[policy].frames.rate
            rows = []
            for segment in segments[number]:
                clip = int(np.searchsorted(stretches[:, 0], segment.frame, side="right")) - 1
                since = (segment.frame - stretches[clip, 0]) / rate
                rows.append([int(before[policy]) + clip, *(round(value, 5) for value in (segment.start, since)),
                             *(round(value, 5) for value in (segment.before, segment.after))])  # fmt: skip
            track: dict[str, Any] = {"name": str(cast.names[number]), "avatar": number}
            for key, names, index in (("team", cast.team_names, "teams"), ("type", cast.type_names, "types")):
                if len(names):
                    track[key] = str(names[int(getattr(cast, index)[number])])
            scale = float(cast.scales[number])
            yield track | {
                "skeleton": list(clips).index(policy),
                "speed": round(float(cast.speeds[number]), 6),
                "girth": round(float(cast.girths[number]), 6),
                "sizes": [round(scale * float(value), 6) for value in cast.stretches[number]],
                "first": int(there[0]),
                "segments": rows,
                "roots": roots[there[0] : there[-1] + 1],
                "between": more.round(4).tolist(),
            }

    def _write_json(self, path: Path, head: dict[str, Any], tracks: Callable[[], Iterator[dict[str, Any]]]) -> None:
        """Write tracks as JSON, an avatar a line."""
        with open(path, "x", encoding="utf-8") as file:
            file.write(json.dumps(head, ensure_ascii=False)[:-1] + ', "avatars": [')
            for number, track in enumerate(tracks()):
                rows = [
                    [round(value, 4) for value in row] if row[0] == row[0] else None for row in track["roots"].tolist()
                ]
                file.write(",\n" if number else "\n")
                file.write(json.dumps(track | {"roots": rows}, ensure_ascii=False, separators=(",", ":")))
            file.write("\n]}\n")

    def _write_parquet(self, path: Path, head: dict[str, Any], tracks: Callable[[], Iterator[dict[str, Any]]]) -> None:
        """Write tracks as Parquet, an avatar a row; what they have in common is JSON in the schema's metadata."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        segment = pa.struct([
            ("clip", pa.int32()), *((name, pa.float32()) for name in ("start", "from", "before", "after")),
        ])  # fmt: skip
        root = pa.struct([(name, pa.float32()) for name in ("x", "lift", "z", "heading")])
        moment = pa.struct([("frame", pa.float32()), *root])
        schema = pa.schema(
            [
                ("name", pa.string()), ("avatar", pa.int32()), ("team", pa.string()), ("type", pa.string()),
                ("skeleton", pa.int32()), ("speed", pa.float32()), ("girth", pa.float32()),
                ("sizes", pa.list_(pa.float32())), ("first", pa.int32()), ("segments", pa.list_(segment)),
                ("roots", pa.list_(root)), ("between", pa.list_(moment)),
            ],
            metadata={"crowdsim": json.dumps(head, ensure_ascii=False)},
        )  # fmt: skip
        with pq.ParquetWriter(path, schema) as writer:
            rows: list[dict[str, Any]] = []

            def flush() -> None:
                writer.write_table(pa.Table.from_pylist(rows, schema))
                rows.clear()

            def named(kind: Any, values: list[list[float]]) -> list[dict[str, float]]:
                return [dict(zip((field.name for field in kind), row, strict=True)) for row in values]

            for track in tracks():
                roots = track["roots"].tolist()
                lists = {"segments": named(segment, track["segments"]), "roots": named(root, roots)}
                rows.append(track | lists | {"between": named(moment, track["between"])})
                if len(rows) == _AT_ONCE:
                    flush()
            if rows:
                flush()


def _turn(angles: Array) -> Array:
    """Return angles as the shortest way around [rad]."""
    return np.asarray((angles + np.pi) % (2.0 * np.pi) - np.pi)


def write_clips(
    sampler: PoseSampler,
    folder: Path,
    fps: float | Fraction = 30,
    frames: tuple[int, int] | None = None,
    avatars: Sequence[int] | Array | None = None,
    rotations: str = "float32",
    threads: int = 1,
) -> list[Path]:
    """Write a bank of clips and tracks into a folder, which is made when missing; see ``ClipSink``.

    Raises:
        OutputError: The folder cannot be made, or a file cannot be written.
    """
    from crowdsim.export.stream import stream_poses
    from crowdsim.files import make_folder

    make_folder(folder)
    return stream_poses(sampler, float(fps), [ClipSink(sampler, folder, fps, frames, avatars, rotations)], threads)[0]
