"""Avatars of a take as one binary glTF 2.0 file: skinned bodies, one animation, metres, y up.

Every size is known before the first pose, so that the description is written first and blocks of poses are put at
their places; memory does not grow with the take. Each avatar has a tree of joints and a skinned mesh at the root of the
scene; avatars of one girth and one length of legs and arms share vertices, all of a build share triangles and weights.
Helper joints ``...Half`` turn half as far as elbows and knees. Cloth, hair, leather and skin have textures.
"""

from __future__ import annotations

import copy
import json
import os
import struct
import threading
import uuid
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from crowdsim.body.anatomy import Build
from crowdsim.body.looks import build_of, roughness
from crowdsim.body.palette import avatar_paints, skin_paints
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.body.skin import Skin, build_skin_of
from crowdsim.body.textures import TEXTURES, texture_png
from crowdsim.core.types import Array, Progress
from crowdsim.crowd.events import OUTCOMES
from crowdsim.errors import OutputError
from crowdsim.export.gltf_kernels import pack_rotations
from crowdsim.export.prop_meshes import GLOSS, PropMesh, prop_meshes
from crowdsim.export.stream import Block, run_all, stream_poses
from crowdsim.files import exists_plain, make_folder, stat_plain
from crowdsim.motion import quaternion
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.skeleton import Skeleton
from crowdsim.motion.strikes import LIMBS
from crowdsim.places.kernels.records import DOOR
from crowdsim.places.mesh import OBSTACLE_KINDS, OBSTACLE_PAINTS, Mesh, join_meshes, mesh_of
from crowdsim.poses.builds import build_skeleton
from crowdsim.poses.sampler import Poses, PoseSampler
from crowdsim.scenario.rates import exact_rate

_ROTATIONS = {"float32": ("<f4", "<i2", "<i2"), "int16": ("<i2", "<i2", "i1")}
"""How rotations are stored: those of joints that carry joints or props; those of other joints, which as 16 bits put
their skin within 0.01 mm; and those of helpers, which only move a fold of skin."""
_CAMERA_TOLERANCES = {"float32": (0.0, 0.0), "int16": (2e-4, 2e-5)}
"""How far cameras may be off between their keys: positions [m], and components of rotations, which is .05 pixels of a
picture 1280 pixels wide."""
_COMPONENTS = {"|i1": 5120, "|u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125, "<f4": 5126}
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_VERTICES, _INDICES = 34962, 34963
_LARGEST = 2**32 - 1
"""Bytes of a binary glTF file at the most, whose header counts them in 32 bits."""
_STILL = 1e-5
"""By how much the quaternion of a joint that never moves may vary, which is what resampling leaves."""


@dataclass(frozen=True)
class CameraPath:
    """A camera that comes along, at every output frame of a file.

    Attributes:
        name: Its name.
        positions: Where the eye is [m]. Shape (F, 3).
        rotations: From a camera that looks along -z, with y up, to this one. Shape (F, 4).
        field: Angle between the upper and lower edge of the picture [rad].
        aspect: Width of the picture for its height.
    """

    name: str
    positions: Array
    rotations: Array
    field: float
    aspect: float


_PROP_PART = -100
"""What stands for props among the parts of skins and kinds of obstacles."""
_FILES_AT_ONCE = 128
"""Files that are open at once where each avatar has one of its own."""
_BALL, _BALL_COLOUR = 0.13, [0.85, 0.50, 0.03]
"""Radius [m] and linear colour of scripted targets, as in pictures."""


class GltfSink:
    """Writes one ``.glb`` of avatars of a take; a ``Sink``.

    Args:
        sampler: Poses of the take.
        path: The file.
        fps: Output frames a second; times are exact for fractions such as 24000/1001.
        frames: First output frame and one past the last; all when None.
        avatars: Numbers of the avatars; all when None.
        rotations: ``float32``, or ``int16``, which takes half the place.
        builds: Build of each avatar of the take; by its girth when None.
        cameras: Cameras that come along, which have as many frames as the file.
        resumes: Whether to continue from the frames that an interrupted export of the same has left, and to leave
            them when interrupted.

    Raises:
        OutputError: The file would be larger than glTF files can be.
    """

    kind = "glb"
    reads_joints = False
    margin = 0

    def __init__(
        self,
        sampler: PoseSampler,
        path: Path,
        fps: float | Fraction,
        frames: tuple[int, int] | None = None,
        avatars: Sequence[int] | Array | None = None,
        rotations: str = "float32",
        builds: Sequence[Build] | None = None,
        cameras: Sequence[CameraPath] = (),
        resumes: bool = False,
    ) -> None:
        take = sampler.take
        self.start, self.stop = frames or (0, take.output_frames(float(fps)))
        self._first, self._frames = self.start, self.stop - self.start
        numbers: Array = np.arange(take.avatar_count) if avatars is None else np.unique(np.asarray(avatars))
        self._sampler, self._path, self._fps, self._rotations = sampler, path, exact_rate(fps), rotations
        there = {int(number): sampler.present(int(number), self.start, self.stop, float(fps)) for number in numbers}
        there = {number: rows for number, rows in there.items() if rows.any()}
        self.avatars: Array = np.array(list(there), np.int64)
        everyone = range(take.avatar_count)
        self._builds = [build_of(take.cast, number) for number in everyone] if builds is None else list(builds)
        self._places: dict[int, _Place] = {}
        self._stills: dict[int, tuple[Array, Array]] = {}
        self._rows, self._part, self._cameras = 0, 0, cameras
        self._shared = GltfFile(path, self._describe(there), resumes)
        self._resume(*self._shared.resume(1))

    @property
    def total(self) -> int:
        """Number of avatars, as whose share of the frames progress counts."""
        return len(self.avatars)

    @property
    def done(self) -> int:
        """Share of the frames written so far."""
        return self.total * self._rows // self._frames

    def split(self, most: int) -> list[GltfSink]:
        """Return sinks of a few avatars each that write into the same file, since each avatar's frames lie together."""
        if len(self.avatars) <= most:
            return [self]
        parts = list[GltfSink]()
        for low in range(0, len(self.avatars), most):
            part = copy.copy(self)
            part.avatars, part._part = self.avatars[low : low + most], len(parts)
            parts.append(part)
        for part, rows in zip(parts, self._shared.resume(len(parts)), strict=True):
            part._resume(rows)
        return parts

    def _resume(self, rows: int) -> None:
        """Continue after ``rows`` frames, or from the first frame if that number is impossible."""
        rows = rows if 0 <= rows <= self._frames else 0
        self.start, self._rows = self._first + rows, rows
        for place in (self._places[number] for number in self.avatars.tolist() if rows):
            place.root = self._shared.read(place.roots + 12 * (rows - 1), "<f4", 3).astype(float)
            for joints, dtype, last, at in place.tracks:
                one, size = _one(dtype), 4 * np.dtype(dtype).itemsize
                for number in range(len(joints)):
                    packed = self._shared.read(at + size * (number * self._frames + rows - 1), dtype, 4)
                    last[number] = packed[[3, 0, 1, 2]] / one

    def write(self, block: Block, pool: ThreadPoolExecutor) -> None:
        """Put a block of frames at its places; there is no file where no avatar ever comes."""
        if not len(self.avatars):
            return
        low, high = max(block.first_output, self.start), min(block.stop_output, self.stop)
        rows = slice(low - block.first, high - block.first)
        chosen = set(map(int, self.avatars))
        work = [
            (poses, column)
            for poses in block.poses
            for column in range(len(poses.avatars))
            if int(poses.avatars[column]) in chosen
        ]
        self._shared.begin()
        run_all(pool, lambda item: self._append(*item, rows, low - self._first), work)
        self._rows = high - self._first
        self._shared.note(self._part, self._rows)

    def _append(self, poses: Poses, column: int, rows: slice, first: int) -> None:
        place = self._places[int(poses.avatars[column])]
        local = poses.rotations[rows, column]
        roots = poses.root_positions[rows, column].astype(np.float64) / float(poses.scales[column])
        there = np.isfinite(roots[:, 0])
        if not there.all():
            # An absent avatar keeps the place that it had.
            seen = np.maximum.accumulate(np.where(there, np.arange(len(roots)), -1))
            roots = np.where(seen[:, None] < 0, place.root, roots[np.maximum(seen, 0)])
        place.root = roots[-1]
        self._shared.put(place.roots + 12 * first, roots.astype("<f4"))
        for joints, dtype, last, at in place.tracks:
            packed = packed_rotations(place.skin, local, joints, dtype, last)
            for number, values in enumerate(packed):
                self._shared.put(at + 4 * packed.itemsize * (number * self._frames + first), values)

    def close(self) -> list[Path]:
        """Give the file its name when all parts are written, and return it."""
        return self._shared.close()

    def abandon(self) -> None:
        """Remove the unfinished file, unless the next call continues it."""
        self._shared.abandon()

    def _describe(self, there: dict[int, Array]) -> Document:
        """Lay out the file: all that is in it but frames, and places for these."""
        take, cast = self._sampler.take, self._sampler.take.cast
        document = Document()
        times = document.add(key_times(np.arange(self._frames), self._fps), limits=True)
        skins: dict[tuple[Any, ...], AddedSkin] = {}
        carried: dict[int, list[PropMesh]] = {}
        channels: list[dict[str, Any]] = []
        samplers: list[dict[str, Any]] = []

        def animate(node: int, path: str, output: int, moments: int = times, steps: bool = False) -> None:
            samplers.append({"input": moments, "output": output, **({"interpolation": "STEP"} if steps else {})})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})

        dresses = avatar_paints(cast.teams, np.asarray(cast.colours, float)[cast.types])
        teams = [str(name) for name in getattr(cast, "team_names", ())]
        for number, rows in there.items():
            policy, build = int(cast.policies[number]), self._builds[number]
            motion = self._sampler.motions[policy]
            lengths, girth = cast.stretches[number][motion.segments], float(cast.girths[number])
            key = policy, build, girth, *cast.stretches[number]
            if key not in skins:
                skin = build_skin_of(self._sampler.policies[policy].database, build).shaped(girth, lengths)
                alike = next((value for key, value in skins.items() if key[:2] == (policy, build)), None)
                skins[key] = document.add_skin(skin, alike)
            skin = skins[key].skin
            skeleton = build_skeleton(motion.skeleton, motion.segments, cast.stretches[number].astype(float))
            name = str(cast.names[number])
            scale = float(cast.scales[number])
            first = len(document.nodes)
            extras = {"avatar": number, "sex": build.sex, "build": build.kind}
            lost = self._health_lost(number)
            if lost:
                extras["health_lost"] = lost
            for key_, names, index in (("team", teams, "teams"), ("type", getattr(cast, "type_names", ()), "types")):
                if len(names):
                    extras[key_] = str(names[int(getattr(cast, index)[number])])
            moving, still = self._moving(policy)
            paints = skin_paints(number, dresses[number], int(cast.types[number]))
            document.add_body(
                name, skeleton, skins[key], np.where(moving[:, None], np.nan, still), paints, scale, extras
            )
            kind = int(cast.types[number])
            if kind not in carried:
                carried[kind] = prop_meshes(cast, kind)
            for prop in carried[kind]:
                document.add_prop(f"{name} {skeleton.names[prop.joint]} prop", first + 1 + prop.joint, prop)
            root, where = document.reserve(self._frames, 1, "<f4", 3)
            place = self._places[number] = _Place(skin, where, np.zeros(3), [])
            animate(first + 1, "translation", root[0])
            holders = [prop.joint for prop in carried[kind]]
            for joints, dtype in stored_rotations(skin, moving, holders, self._rotations):
                outputs, where = document.reserve(self._frames, len(joints), dtype, 4)
                place.tracks.append((joints, dtype, np.tile([1.0, 0.0, 0.0, 0.0], (len(joints), 1)), where))
                for joint, output in zip(joints.tolist(), outputs, strict=True):
                    animate(first + 1 + joint, "rotation", output)
            if not rows.all():
                changes = np.append(0, np.flatnonzero(np.diff(rows)) + 1)
                shown = np.where(rows[changes], np.float32(scale), np.float32(0.0))
                moments = document.add(key_times(changes, self._fps), limits=True)
                animate(first, "scale", document.add(np.repeat(shown[:, None], 3, axis=1)), moments, steps=True)
        self._add_targets(document, animate)
        self._add_obstacles(document, animate)
        for camera in self._cameras:
            document.add_camera(camera, animate, self._fps, self._rotations)
        document.json["animations"] = [{"name": str(take.scenario), "samplers": samplers, "channels": channels}]
        document.json["scenes"][0]["extras"] = self._extras(there)
        document.json["scenes"][0]["name"] = str(take.scenario)
        return document

    def _moving(self, policy: int) -> tuple[Array, Array]:
        """Return ``moving_joints`` of a policy."""
        if policy not in self._stills:
            self._stills[policy] = moving_joints(self._sampler.policies[policy].database)
        return self._stills[policy]

    def _seconds(self) -> Array:
        """Return the time of every strike of the take from the first frame of the file on [s]."""
        take = self._sampler.take
        return np.asarray(take.events.frame, float) / take.control_rate - float(self.start / self._fps)

    def _health_lost(self, avatar: int) -> list[list[float]]:
        """Return what strikes have taken from an avatar's health so far, at each that did: seconds and points."""
        events, seconds = self._sampler.take.events, self._seconds()
        hurt = (np.asarray(events.victim) == avatar) & (np.asarray(events.damage) > 0.0)
        hurt &= seconds <= float((self._frames - 1) / self._fps)
        rows = np.flatnonzero(hurt)[np.argsort(seconds[hurt], kind="stable")]
        points = np.cumsum(np.asarray(events.damage, float)[rows])
        # What was lost before the first frame is lost there.
        times, last = np.unique(np.maximum(np.round(seconds[rows], 4), 0.0)[::-1], return_index=True)
        return [[float(time), round(float(value), 3)] for time, value in zip(times, points[::-1][last], strict=True)]

    def _add_targets(self, document: Document, animate: Callable[[int, str, int], None]) -> None:
        """Add a ball for each scripted target."""
        take = self._sampler.take
        control = np.arange(self.start, self.stop) / float(self._fps) * take.control_rate
        control = np.minimum(control, take.frame_count - 1)
        before = np.floor(control + 1e-9).astype(np.int64)
        rows = np.asarray(take.targets[int(before[0]) : int(before[-1]) + 2], float)
        low = before - before[0]
        high = np.minimum(low + 1, len(rows) - 1)
        places = rows[low] + np.maximum(control - before, 0.0)[:, None, None] * (rows[high] - rows[low])
        for number in range(places.shape[1]):
            if number == 0:
                ball = document.add_ball(_BALL)
            document.nodes.append({"name": f"target_{number}", "mesh": ball})
            document.json["scenes"][0]["nodes"].append(len(document.nodes) - 1)
            animate(len(document.nodes) - 1, "translation", document.add(places[:, number].astype("<f4")))

    def _add_obstacles(self, document: Document, animate: Callable[..., None]) -> None:
        """Add a node for each obstacle, and one for each door, which is scaled to nothing while it is open."""
        parts = self._sampler.obstacles
        keys, doors = list[tuple[int, int, int]](), Counter[int]()
        for kind, number in zip(parts["kind"].tolist(), parts["obstacle"].tolist(), strict=True):
            doors[number] += kind == DOOR
            keys.append((kind, number, doors[number] if kind == DOOR else 0))
        for key in dict.fromkeys(keys):
            kind, number, door = key
            shown = parts[[one == key for one in keys]]
            name = "ring" if number < 0 else f"obstacle_{number}"
            node = document.add_obstacle(
                f"{name}_door_{door}" if door else name, kind, [mesh_of(part) for part in shown]
            )
            times = [float(shown[key][0]) - float(self.start / self._fps) for key in ("opens", "closes")]
            changes = sorted({0.0, *(time for time in times if 0.0 < time <= float((self._frames - 1) / self._fps))})
            stands = [not times[0] <= time < times[1] for time in changes]
            if not all(stands):
                moments = document.add(np.array(changes, "<f4"), limits=True)
                scales = np.repeat(np.array(stands, "<f4")[:, None], 3, axis=1)
                animate(node, "scale", document.add(scales), moments, True)

    def _extras(self, there: dict[int, Array]) -> dict[str, Any]:
        """What a scene says of its crowd: rate, first frame, and strikes as one list for each of their properties."""
        take = self._sampler.take
        found: dict[str, Any] = {"fps": str(self._fps), "first_frame": self.start, "seed": int(take.seed)}
        events = take.events
        seconds = self._seconds()
        inside = (seconds >= 0.0) & (seconds <= float((self._frames - 1) / self._fps))
        inside &= np.isin(np.asarray(events.attacker), list(there))
        rows = np.flatnonzero(inside)
        found["strikes"] = {
            "seconds": [round(float(seconds[row]), 4) for row in rows],
            "attacker": [int(events.attacker[row]) for row in rows],
            "victim": [int(events.victim[row]) for row in rows],
            "limb": [LIMBS[int(events.limb[row])] for row in rows],
            "outcome": [OUTCOMES[int(events.outcome[row])] for row in rows],
            "point": [[round(float(value), 3) for value in events.point[row]] for row in rows],
        }
        if np.any(np.asarray(events.damage)[rows] > 0.0):
            found["strikes"]["damage"] = [round(float(events.damage[row]), 3) for row in rows]
        return found


@dataclass
class _Place:
    """Where the frames of an avatar lie in the file, and how its last one ended.

    Attributes:
        skin: Its skin.
        roots: Where its roots lie.
        root: The last of them [m]. Shape (3,).
        tracks: Joints and helpers; how their rotations are stored; the last of these, shape (k, 4); where they lie.
    """

    skin: Skin
    roots: int
    root: Array
    tracks: list[tuple[Array, str, Array, int]]


@dataclass(frozen=True)
class AddedSkin:
    """A skin in a file, with the accessors of its vertices, of triangles of parts of one paint, and its bindings."""

    skin: Skin
    attributes: dict[str, int]
    triangles: dict[tuple[int, ...], int]
    bindings: int


class Document:
    """The description of a file, its constant data, and places for its frames."""

    def __init__(self) -> None:
        self.nodes: list[dict[str, Any]] = []
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "crowdsim"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": self.nodes,
            "meshes": [],
            "skins": [],
            "materials": [],
            "accessors": [],
            "bufferViews": [],
        }
        self.constant: list[tuple[int, bytes]] = []
        self.materials: dict[tuple[tuple[int, ...], bytes], int] = {}
        self.props: dict[bytes, int] = {}
        self.textures: dict[str, tuple[int, Array]] = {}
        self.size = 0

    def add(self, values: Array, target: int | None = None, limits: bool = False) -> int:
        """Add an array, a row an element, and return its accessor."""
        values = np.ascontiguousarray(values)
        (accessor,), _ = self.reserve(
            len(values), 1, values.dtype.str, 1 if values.ndim == 1 else values.shape[1], target
        )
        self.constant.append((self.json["bufferViews"][-1]["byteOffset"], values.tobytes()))
        if limits:
            columns = values.reshape(len(values), -1)
            self.json["accessors"][accessor]["min"] = [float(value) for value in columns.min(axis=0)]
            self.json["accessors"][accessor]["max"] = [float(value) for value in columns.max(axis=0)]
        return accessor

    def reserve(
        self, length: int, count: int, dtype: str, width: int, target: int | None = None
    ) -> tuple[list[int], int]:
        """Reserve place for some accessors of one length, one after the other; return them and where they begin."""
        dtype, start = np.dtype(dtype).str, self.size
        each = length * width * np.dtype(dtype).itemsize
        view = {"buffer": 0, "byteOffset": start, "byteLength": each * count}
        self.json["bufferViews"].append(view if target is None else {**view, "target": target})
        # Whole numbers of four columns are rotations and weights; joints of vertices are what they are.
        integer = dtype in ("<i2", "|i1") or (dtype == "<u2" and width == 4)
        for number in range(count):
            self.json["accessors"].append({
                "bufferView": len(self.json["bufferViews"]) - 1,
                "componentType": _COMPONENTS[dtype],
                **({"byteOffset": each * number} if number else {}),
                **({"normalized": True} if integer else {}),
                "count": length,
                "type": _KINDS[width],
            })  # fmt: skip
        self.size += -(-each * count // 4) * 4
        last = len(self.json["accessors"])
        return list(range(last - count, last)), start

    def add_skin(self, skin: Skin, alike: AddedSkin | None = None) -> AddedSkin:
        """Add the vertices of a shape; what it shares with one of the same build is there once."""
        if alike is None:
            shared = {
                "JOINTS_0": self.add(skin.joints, _VERTICES),
                "WEIGHTS_0": self.add(_whole_weights(skin.weights), _VERTICES),
                "TEXCOORD_0": self.add(skin.places, _VERTICES),
            }
            triangles = dict[tuple[int, ...], int]()
        else:
            keys = "JOINTS_0", "WEIGHTS_0", "TEXCOORD_0"
            shared, triangles = {key: alike.attributes[key] for key in keys}, alike.triangles
        matrices = np.zeros((len(skin.positions), 4, 4), "<f4")
        matrices[:, :3] = skin.inverse_bindings()
        matrices[:, 3, 3] = 1.0
        attributes = {
            "POSITION": self.add(skin.vertices, _VERTICES, limits=True),
            "NORMAL": self.add(skin.normals, _VERTICES),
            **shared,
        }
        bindings = self.add(np.ascontiguousarray(matrices.transpose(0, 2, 1)).reshape(-1, 16))
        return AddedSkin(skin, attributes, triangles, bindings)

    def add_body(
        self,
        name: str,
        skeleton: Skeleton,
        added: AddedSkin,
        rotations: Array,
        paints: Array,
        scale: float,
        extras: dict[str, Any],
    ) -> int:
        """Add a tree of joints, and a skinned mesh beside it, to the root of the scene; return the tree's node.

        The joints follow the node, helpers last. Parts of one paint are one primitive.

        Args:
            name: Name of the body.
            skeleton: Its skeleton.
            added: Its skin.
            rotations: Local rotations of joints; NaN for those of the binding pose. Shape (J, 4).
            paints: Paint of each part of a skin (``skin_paints``). Shape (P, 4).
            scale: Its size.
            extras: What its node says of it.
        """
        skin, first = added.skin, len(self.nodes)
        self.nodes.append({"name": name, "scale": [round(scale, 7)] * 3, "children": [first + 1], "extras": extras})
        parents = [*skin.parents, *skin.parents[skin.helpers]]
        offsets = np.concatenate([skeleton.offsets, skeleton.offsets[skin.helpers]])
        names = [*skeleton.names, *(f"{skeleton.names[joint]}Half" for joint in skin.helpers)]
        local = quaternion.multiply(quaternion.conjugate(skin.rotations[parents]), skin.rotations)
        local[0] = skin.rotations[0]
        given = np.isfinite(rotations[:, 0])
        local[: len(rotations)][given] = rotations[given]
        for joint in range(len(parents)):
            below = [first + 1 + child for child, parent in enumerate(parents) if parent == joint]
            w, x, y, z = (round(float(value), 5) for value in local[joint])
            self.nodes.append({
                "name": names[joint],
                "translation": [round(float(value), 7) for value in offsets[joint]],
                **({"rotation": [x, y, z, w]} if w != 1.0 else {}),
                **({"children": below} if below else {}),
            })  # fmt: skip
        self.json["skins"].append({
            "name": name,
            "inverseBindMatrices": added.bindings,
            "skeleton": first + 1,
            "joints": list(range(first + 1, first + 1 + len(parents))),
        })  # fmt: skip
        alike = dict[tuple[Any, ...], list[int]]()
        for part in np.unique(skin.parts).tolist():
            key = *paints[part, :3].tolist(), roughness(part), TEXTURES.get(SKIN_PARTS[part])
            alike.setdefault(key, []).append(part)
        primitives = []
        for parts in map(tuple, alike.values()):
            if parts not in added.triangles:
                chosen = skin.triangles[np.isin(skin.parts, parts)]
                added.triangles[parts] = self.add(chosen.astype("<u2").ravel(), _INDICES)
            material = self.material(parts, paints[parts[0], :3])
            # Validators note coordinates that no texture uses.
            unused = () if SKIN_PARTS[parts[0]] in TEXTURES else ("TEXCOORD_0",)
            attributes = {key: value for key, value in added.attributes.items() if key not in unused}
            primitives.append({"attributes": attributes, "indices": added.triangles[parts], "material": material})
        self.json["meshes"].append({"name": name, "primitives": primitives})
        skinned = len(self.json["meshes"]) - 1
        self.nodes.append({"name": f"{name} skin", "mesh": skinned, "skin": len(self.json["skins"]) - 1})
        self.json["scenes"][0]["nodes"] += [first, len(self.nodes) - 1]
        return first

    def add_camera(self, camera: CameraPath, animate: Callable[..., None], fps: Fraction, rotations: str) -> None:
        """Add a camera, a node that moves, at the root of the scene; it has keys where a line between others is off.

        Args:
            camera: The camera.
            animate: Adds a track of a node: node, path, accessor of the values, and of their times if not all frames.
            fps: Output frames a second.
            rotations: ``float32``, which leaves out keys only where nothing changes, or ``int16``.
        """
        cameras = self.json.setdefault("cameras", [])
        cameras.append({
            "name": camera.name,
            "type": "perspective",
            "perspective": {"aspectRatio": round(camera.aspect, 6), "yfov": round(camera.field, 6), "znear": 0.05},
        })  # fmt: skip
        self.nodes.append({"name": camera.name, "camera": len(cameras) - 1})
        self.json["scenes"][0]["nodes"].append(len(self.nodes) - 1)
        turned = quaternion.continuous(camera.rotations)[:, [1, 2, 3, 0]]
        tracks = ("translation", camera.positions, "<f4"), ("rotation", turned, _ROTATIONS[rotations][0])
        for (path, values, dtype), tolerance in zip(tracks, _CAMERA_TOLERANCES[rotations], strict=True):
            keys, one = sparse_keys(values, tolerance), _one(dtype)
            stored = (values if one == 1.0 else np.round(one * values)).astype(dtype)
            # A key of a track that has not all frames takes four bytes more, for its time.
            if len(keys) * (stored[0].nbytes + 4) < stored.nbytes:
                moments = self.add(key_times(keys, fps), limits=True)
                animate(len(self.nodes) - 1, path, self.add(stored[keys]), moments)
            else:
                animate(len(self.nodes) - 1, path, self.add(stored))

    def add_obstacle(self, name: str, kind: int, meshes: list[Mesh]) -> int:
        """Add an obstacle to the root of the scene, and return its node."""
        mesh = join_meshes(meshes)
        attributes = {
            "POSITION": self.add(mesh.positions.astype("<f4"), _VERTICES, limits=True),
            "NORMAL": self.add(mesh.normals.astype("<f4"), _VERTICES),
        }
        key = ((-1 - kind,), b"")
        if key not in self.materials:
            *colour, shine = OBSTACLE_PAINTS[kind]
            self.materials[key] = self._add_material(OBSTACLE_KINDS[kind], colour, round(1.0 - shine, 3))
        indices = self.add(mesh.triangles.astype("<u4").ravel(), _INDICES)
        primitive = {"attributes": attributes, "indices": indices, "material": self.materials[key]}
        self.json["meshes"].append({"name": name, "primitives": [primitive]})
        self.nodes.append({"name": name, "mesh": len(self.json["meshes"]) - 1})
        self.json["scenes"][0]["nodes"].append(len(self.nodes) - 1)
        return len(self.nodes) - 1

    def add_prop(self, name: str, joint: int, prop: PropMesh, extras: dict[str, Any] | None = None) -> None:
        """Add a prop to the node of a joint, which moves it; props that are alike share a mesh.

        Args:
            name: Name of its node.
            joint: Node of the joint.
            prop: The prop.
            extras: What its node says of it.
        """
        if prop.key not in self.props:
            primitives = []
            for mesh, colour in prop.parts:
                key = ((_PROP_PART,), np.array(colour).tobytes())
                if key not in self.materials:
                    self.materials[key] = self._add_material("prop", list(colour), 1.0 - GLOSS)
                    # Meshes from files need not be closed.
                    self.json["materials"][-1]["doubleSided"] = True
                primitives.append({
                    "attributes": {
                        "POSITION": self.add(mesh.positions.astype("<f4"), _VERTICES, limits=True),
                        "NORMAL": self.add(mesh.normals.astype("<f4"), _VERTICES),
                    },
                    "indices": self.add(mesh.triangles.astype("<u4").ravel(), _INDICES),
                    "material": self.materials[key],
                })  # fmt: skip
            self.props[prop.key] = len(self.json["meshes"])
            self.json["meshes"].append({"name": f"prop_{len(self.props) - 1}", "primitives": primitives})
        self.nodes[joint].setdefault("children", []).append(len(self.nodes))
        self.nodes.append({"name": name, "mesh": self.props[prop.key], **({"extras": extras} if extras else {})})

    def add_ball(self, radius: float) -> int:
        """Add a ball as a mesh, and return it."""
        rings, around = 9, 16
        down, turn = (
            grid.ravel()
            for grid in np.meshgrid(np.linspace(0, np.pi, rings), np.arange(around) * 2 * np.pi / around, indexing="ij")
        )
        normals = np.stack([np.sin(down) * np.sin(turn), np.cos(down), np.sin(down) * np.cos(turn)], axis=1)
        first = np.arange((rings - 1) * around)
        beside = first - first % around + (first + 1) % around
        faces = np.concatenate([
            np.stack([first, first + around, beside], axis=1)[around:],
            np.stack([beside, first + around, beside + around], axis=1)[:-around],
        ])  # fmt: skip
        attributes = {
            "POSITION": self.add((radius * normals).astype("<f4"), _VERTICES, limits=True),
            "NORMAL": self.add(normals.astype("<f4"), _VERTICES),
        }
        indices = self.add(faces.astype("<u2").ravel(), _INDICES)
        material = self._add_material("target", _BALL_COLOUR, 0.5)
        self.json["meshes"].append({
            "name": "target", "primitives": [{"attributes": attributes, "indices": indices, "material": material}],
        })  # fmt: skip
        return len(self.json["meshes"]) - 1

    def material(self, parts: tuple[int, ...], colour: Array) -> int:
        """Return the material of parts of one roughness and texture in a linear colour, named after them."""
        key, known = (parts, np.round(colour, 4).tobytes()), self.materials
        if key not in known:
            name = "+".join(SKIN_PARTS[part] for part in parts)
            texture, most = self._texture(SKIN_PARTS[parts[0]])
            linear = [round(min(float(value), 1.0), 4) for value in colour * most]
            known[key] = self._add_material(name, linear, roughness(parts[0]))
            if texture is not None:
                shown = self.json["materials"][-1]["pbrMetallicRoughness"]
                shown["baseColorTexture"] = {"index": texture}
        return known[key]

    def _texture(self, part: str) -> tuple[int | None, Array]:
        """Return the texture of a part, added once, and the linear colour that takes it to white in the mean."""
        name = TEXTURES.get(part)
        if name is None:
            return None, np.ones(3)
        if name not in self.textures:
            data, most = texture_png(name)
            images, textures = (self.json.setdefault(key, []) for key in ("images", "textures"))
            images.append({"name": name, "mimeType": "image/png", "bufferView": len(self.json["bufferViews"])})
            self.json["bufferViews"].append({"buffer": 0, "byteOffset": self.size, "byteLength": len(data)})
            self.constant.append((self.size, data))
            self.size += -(-len(data) // 4) * 4
            textures.append({"source": len(images) - 1})
            self.textures[name] = len(textures) - 1, most
        return self.textures[name]

    def _add_material(self, name: str, colour: Sequence[float], rough: float) -> int:
        """Add a material in a linear colour, and return it."""
        self.json["materials"].append({
            "name": name,
            "pbrMetallicRoughness": {
                "baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": rough,
            },
        })  # fmt: skip
        return len(self.json["materials"]) - 1


class GltfFile:
    """The file while it is written, of a sink or of the parts that one was split into.

    Until the file is complete, its last byte is followed by the number of frames written of each part, as int64.

    Args:
        path: The file.
        document: What is in it.
        resumes: Whether to continue an unfinished file of the same, and to leave one, under a name that is always the
            same.
    """

    def __init__(self, path: Path, document: Document, resumes: bool = False) -> None:
        self._open, self._parts, self._path, self._constant = 1, 1, path, document.constant
        self._resumes, self._end = resumes, document.size
        self._partial = path.with_name(f".{path.name[:100]}.{'' if resumes else uuid.uuid4().hex + '.'}part")
        self._file: BinaryIO | None = None
        self._lock = threading.Lock()
        document.json["buffers"] = [{"byteLength": document.size}]
        text = json.dumps(document.json, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        size = 28 + len(text) + document.size
        if size > _LARGEST:
            raise OutputError(
                f"{path}: would have {size / 1e9:.1f} GB, glTF files have at most 4.3; "
                "export fewer avatars or frames, a lower rate, or rotations as int16"
            )
        self._size = size
        self._head = struct.pack("<4sIIII", b"glTF", 2, size, len(text), 0x4E4F534A) + text
        self._head += struct.pack("<II", document.size, 0x004E4942)

    def resume(self, parts: int) -> list[int]:
        """Return how many frames of each part an interrupted process has written, and continue its file."""
        if self._file is not None:
            self._file.close()
        self._open, self._parts, self._file = parts, parts, None
        nothing, place = [0] * parts, (self._partial.parent, self._partial.name)
        if not self._resumes or not exists_plain(*place) or stat_plain(*place).st_size != self._size + 8 * parts:
            return nothing
        try:
            file = open(self._partial, "r+b", buffering=0)  # noqa: SIM115 - it stays open
        except OSError as error:
            raise self._failed(error) from error
        if file.read(len(self._head)) != self._head:
            file.close()
            return nothing
        self._file = file
        return self.read(self._end, "<i8", parts).tolist()

    def read(self, at: int, dtype: str, count: int) -> Array:
        """Return values at a place among the binary data."""
        assert self._file is not None
        try:
            self._file.seek(len(self._head) + at)
            return np.frombuffer(self._file.read(np.dtype(dtype).itemsize * count), dtype)
        except OSError as error:
            raise self._failed(error) from error

    def begin(self) -> None:
        """Write all that is no frame, unless it is written."""
        if self._file is not None:
            return
        try:
            self._partial.unlink(missing_ok=True)
            self._file = open(self._partial, "xb", buffering=0)  # noqa: SIM115 - it stays open
            self._file.truncate(self._size)
        except OSError as error:
            raise self._failed(error) from error
        self.put(-len(self._head), self._head)
        for at, data in self._constant:
            self.put(at, data)
        self.put(self._end, np.zeros(self._parts, "<i8"))

    def note(self, part: int, rows: int) -> None:
        """Note that so many frames of a part are written."""
        self.put(self._end + 8 * part, np.array([rows], "<i8"))

    def put(self, at: int, data: bytes | Array) -> None:
        """Write data at its place among the binary data."""
        assert self._file is not None
        rest = memoryview(data).cast("B")  # type: ignore[arg-type]
        try:
            with self._lock:
                self._file.seek(len(self._head) + at)
                while rest:
                    rest = rest[self._file.write(rest) :]
        except OSError as error:
            raise self._failed(error) from error

    def close(self) -> list[Path]:
        """Give the file its name when the last part is closed, and return it then."""
        self._open -= 1
        if self._open > 0 or self._file is None:
            return []
        try:
            self._file.truncate(self._size)
            self._file.close()
            os.replace(self._partial, self._path)
        except OSError as error:
            self.abandon()
            raise self._failed(error) from error
        return [self._path]

    def abandon(self) -> None:
        """Remove the unfinished file, unless the next call continues it."""
        if self._file is not None:
            self._file.close()
            if not self._resumes:
                self._partial.unlink(missing_ok=True)

    def _failed(self, error: OSError) -> OutputError:
        return OutputError(f"{self._path}: cannot be written: {error.strerror or error}")


class SplitGltfSink:
    """Writes a ``.glb`` for each avatar, of the frames from its first to its last; a ``Sink``.

    Args:
        sampler: Poses of the take.
        paths: File of each of the avatars.
        fps: Output frames a second.
        frames: First output frame and one past the last.
        avatars: Numbers of the avatars, ascending.
        rotations: ``float32`` or ``int16``.

    Raises:
        OutputError: A file would be larger than glTF files can be.
    """

    kind, reads_joints, margin = "glb", False, 0

    def __init__(
        self,
        sampler: PoseSampler,
        paths: Sequence[Path],
        fps: float | Fraction,
        frames: tuple[int, int],
        avatars: Sequence[int] | Array,
        rotations: str = "float32",
    ) -> None:
        self.start, self.stop = frames
        self.avatars: Array = np.asarray(avatars)
        self._arguments = sampler, fps, frames, rotations
        self._paths = dict(zip(self.avatars.tolist(), paths, strict=True))
        self._sinks: list[GltfSink] | None = None

    @property
    def total(self) -> int:
        """Number of files, those of avatars that are never there included."""
        return len(self.avatars)

    @property
    def done(self) -> int:
        """Number of files written so far."""
        return sum(sink.done for sink in self._sinks or ())

    def split(self, most: int) -> list[SplitGltfSink]:
        """Return sinks of a few avatars each, and of no more files than are written at once."""
        sampler, fps, frames, rotations = self._arguments
        size = min(most, _FILES_AT_ONCE)
        parts = [self.avatars[low : low + size] for low in range(0, len(self.avatars), size)]
        return [
            SplitGltfSink(sampler, [self._paths[one] for one in part.tolist()], fps, frames, part, rotations)
            for part in parts
        ]

    def write(self, block: Block, pool: ThreadPoolExecutor) -> None:
        """Put a block of frames into the files of the avatars that are there."""
        if self._sinks is None:
            self._sinks = self._open()
        for sink in self._sinks:
            if sink.start < block.stop_output and sink.stop > block.first_output:
                sink.write(block, pool)

    def close(self) -> list[Path]:
        """Give the files their names and return them, in the order of the avatars."""
        return [path for sink in self._sinks or () for path in sink.close()]

    def abandon(self) -> None:
        """Remove what is half-written."""
        for sink in self._sinks or ():
            sink.abandon()

    def _open(self) -> list[GltfSink]:
        sampler, fps, (start, stop), rotations = self._arguments
        sinks = []
        for avatar, path in self._paths.items():
            there = start + np.flatnonzero(sampler.present(avatar, start, stop, float(fps)))
            if len(there):
                frames = int(there[0]), int(there[-1]) + 1
                sinks.append(GltfSink(sampler, path, fps, frames, [avatar], rotations))
        return sinks


def moving_joints(database: MotionDatabase) -> tuple[Array, Array]:
    """Return which joints of motion are animated (J,), and the rotation of those that never move (J, 4).

    Fingers, eyes and the like, beyond the hands and the head, are left out where motion never moves them: poses are not
    changed there.
    """
    parents = database.skeleton.parents
    moving, still = np.ones(len(parents), bool), np.zeros((len(parents), 4))
    ends = [database.body.roles[role] for role in ("head", "left_hand", "right_hand")]
    beyond = np.zeros(len(parents), bool)
    for child, parent in enumerate(parents):
        beyond[child] = parent >= 0 and (beyond[parent] or parent in ends)
    for joint in np.flatnonzero(beyond):
        own = np.asarray(database.rotations[:, joint])
        moving[joint] = bool(np.ptp(own, axis=0).max() > _STILL)
        still[joint] = own[0]
    return moving, still


def stored_rotations(skin: Skin, moving: Array, holders: Sequence[int], rotations: str) -> list[tuple[Array, str]]:
    """Return the animated joints and helpers of a skin by how their rotations are stored.

    Args:
        skin: The skin; its helpers are numbered after its joints.
        moving: Which joints are animated. Shape (J,), bool.
        holders: Joints that carry props.
        rotations: ``float32`` or ``int16``.
    """
    joints, helpers = np.flatnonzero(moving), len(skin.parents) + np.arange(len(skin.helpers))
    carrying = np.isin(joints, [*skin.parents, *holders])
    groups = joints[carrying], joints[~carrying], helpers
    return [(some, dtype) for some, dtype in zip(groups, _ROTATIONS[rotations], strict=True) if len(some)]


def packed_rotations(skin: Skin, local: Array, joints: Array, dtype: str, last: Array) -> Array:
    """Return rotations as a file stores them, joint by joint, x, y, z, w. Shape (k, T, 4).

    Args:
        skin: The skin.
        local: Local rotations of all joints; NaN while absent. Shape (T, J, 4).
        joints: Numbers of joints, or of helpers. Shape (k,).
        dtype: How rotations are stored.
        last: Rotations before the first, which become those of the last. Shape (k, 4), float64.
    """
    own = joints[0] < len(skin.parents)
    chosen = local[:, joints] if own else skin.helper_rotations(local)[:, joints - len(skin.parents)]
    one = _one(dtype)
    packed = np.empty((1, len(joints), len(local), 4), dtype)
    pack_rotations(0, 1, np.ascontiguousarray(chosen[:, None], np.float32), last[None], one, packed)
    return packed[0]


def write_gltf(
    sampler: PoseSampler,
    path: Path,
    frames: tuple[int, int] | None = None,
    fps: float | Fraction = 60,
    avatars: Sequence[int] | Array | None = None,
    rotations: str = "float32",
    threads: int = 1,
    progress: Progress | None = None,
    builds: Sequence[Build] | None = None,
    cameras: Sequence[CameraPath] = (),
) -> list[Path]:
    """Write avatars of a take as one ``.glb``; see ``GltfSink``.

    Args:
        sampler: Poses of the take.
        path: The file; its folder is made when missing.
        frames: First output frame and one past the last; all when None.
        fps: Output frames a second; fractions such as 24000/1001 are exact.
        avatars: Numbers of the avatars; all when None.
        rotations: ``float32`` or ``int16``.
        threads: Threads that write.
        progress: Called with ("glb", avatars done, avatars).
        builds: Build of each avatar of the take; by its girth when None.
        cameras: Cameras that come along.

    Returns:
        The file, or nothing where no avatar is there in these frames.

    Raises:
        OutputError: The folder cannot be made, or the file cannot be written or would be too large.
    """
    make_folder(path.parent)
    sink = GltfSink(sampler, path, fps, frames, avatars, rotations, builds, cameras)
    return stream_poses(sampler, float(fps), [sink], threads, progress)[0]


def _one(dtype: str) -> float:
    """Return what a one is stored as."""
    return 1.0 if dtype == "<f4" else float(np.iinfo(dtype).max)


def _whole_weights(weights: Array) -> Array:
    """Weights as whole numbers that add up to 65535; the greatest, the first, takes what rounding leaves."""
    whole = np.round(weights * 65535.0).astype(np.int64)
    whole[:, 0] += 65535 - whole.sum(axis=1)
    return whole.astype("<u2")


def sparse_keys(values: Array, tolerance: float) -> Array:
    """Return frames that are enough as keys: lines between them are within a tolerance of all others. Shape (k,).

    Args:
        values: A row for each frame. Shape (F, n).
        tolerance: How far each value may be off.
    """
    keys, last = [0], values[0]
    low, high = np.full(values.shape[1], -np.inf), np.full(values.shape[1], np.inf)
    for frame, row in enumerate(values[1:], 1):
        slope = (row - last) / (frame - keys[-1])
        if np.any(slope < low) or np.any(slope > high):
            keys.append(frame - 1)
            last = values[frame - 1]
            slope, low, high = row - last, np.full_like(low, -np.inf), np.full_like(high, np.inf)
        # Lines that pass through the last key and close enough to this frame.
        reach = tolerance / (frame - keys[-1])
        low, high = np.maximum(low, slope - reach), np.minimum(high, slope + reach)
    if np.any(values[-1] != last):
        keys.append(len(values) - 1)
    return np.array(keys)


def key_times(frames: Array, fps: Fraction) -> Array:
    """Times of frames [s], float32."""
    return (np.asarray(frames, float) * fps.denominator / fps.numerator).astype("<f4")
