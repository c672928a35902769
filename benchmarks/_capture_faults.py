"""Captures with faults, made from clean ones: each beside the clean twin that it was made from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from crowdsim.bvh.io import Bvh, from_clip, to_clip
from crowdsim.capture.columns import path_of, position_columns, rotation_columns, with_path
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.mirroring import mirrored
from crowdsim.motion.roles import find_roles
from crowdsim.motion.skeleton import Clip

Array = NDArray[np.float64]
Change = Callable[[Bvh], Bvh]


def rate_of(fps: float) -> Change:
    """Write a frame time that means another rate."""
    return lambda bvh: replace(bvh, fps=fps, frame_time=1.0 / fps)


def timed_in(unit: Callable[[float], float]) -> Change:
    """Write the frame time in another unit; ``unit`` gives the number for a rate."""

    def change(bvh: Bvh) -> Bvh:
        return rate_of(1.0 / unit(bvh.fps))(bvh)

    return change


def root_scaled(factor: float) -> Change:
    """Write the root's positions in another unit."""
    return lambda bvh: with_path(bvh, 0, path_of(bvh, 0) * factor)


def in_metres(bvh: Bvh) -> Bvh:
    """Write a file in metres instead of centimetres."""
    small = replace(bvh, offsets=0.01 * bvh.offsets, end_offsets=0.01 * bvh.end_offsets)
    return with_path(small, 0, 0.01 * path_of(bvh, 0))


def bones_in_inches(bvh: Bvh) -> Bvh:
    """Write bones in inches, and the root's positions in centimetres as before."""
    return replace(bvh, offsets=bvh.offsets / 2.54, end_offsets=bvh.end_offsets / 2.54)


def root_exchanged(bvh: Bvh) -> Bvh:
    """Write the root's path with z up and all else with y up."""
    path = path_of(bvh, 0)
    return with_path(bvh, 0, path[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0]))


def root_displacements(bvh: Bvh) -> Bvh:
    """Write by how much the root moves in each frame."""
    path = path_of(bvh, 0)
    return with_path(bvh, 0, np.diff(path, axis=0, prepend=path[:1]))


def root_step(bvh: Bvh) -> Bvh:
    """Let the root step to the side by 60 % of a leg in the middle of the clip, and stay there."""
    path = path_of(bvh, 0)
    path[len(path) // 2 :, 0] += 0.6 * _leg(bvh)
    return with_path(bvh, 0, path)


def root_drifting(share: float) -> Change:
    """Let the root drift by a share of a leg a second, aside and up."""

    def change(bvh: Bvh) -> Bvh:
        path = path_of(bvh, 0)
        path += np.arange(len(path))[:, None] / bvh.fps * _leg(bvh) * share * np.array([0.75, 0.125, 0.625])
        return with_path(bvh, 0, path)

    return change


def root_at_origin(bvh: Bvh) -> Bvh:
    """Put the root to the origin for six frames in the middle of the clip."""
    path, middle = path_of(bvh, 0), bvh.frame_count // 2
    path[middle : middle + 6] = 0.0
    return with_path(bvh, 0, path)


def rows_of_zeros(bvh: Bvh) -> Bvh:
    """Write zeros in all channels of six frames in the middle of the clip."""
    motion, middle = bvh.motion.copy(), bvh.frame_count // 2
    motion[middle : middle + 6] = 0.0
    return replace(bvh, motion=motion)


def root_held(bvh: Bvh) -> Bvh:
    """Write every fifth position of the root five times."""
    path = path_of(bvh, 0)
    return with_path(bvh, 0, path[np.arange(len(path)) // 5 * 5])


def in_place(bvh: Bvh) -> Bvh:
    """Keep the root over one point of the ground."""
    path = path_of(bvh, 0)
    path[:, [0, 2]] = path[:1, [0, 2]]
    return with_path(bvh, 0, path)


def left_handed(bvh: Bvh) -> Bvh:
    """Mirror the file at x, names of left and right as they were."""
    signs = np.ones(bvh.channel_count)
    starts = bvh.first_channels()
    for joint, names in enumerate(bvh.channels):
        for place, name in enumerate(names):
            if name in ("Xposition", "Yrotation", "Zrotation"):
                signs[starts[joint] + place] = -1.0
    mirror = np.array([-1.0, 1.0, 1.0])
    return replace(bvh, motion=bvh.motion * signs, offsets=bvh.offsets * mirror, end_offsets=bvh.end_offsets * mirror)


def tilted(degrees: float, about: float) -> Change:
    """Rotate the motion about a horizontal axis, as the axes of a camera do."""

    def change(bvh: Bvh) -> Bvh:
        half = np.deg2rad(degrees) / 2.0
        turn = np.array([np.cos(half), np.sin(half) * np.cos(about), 0.0, np.sin(half) * np.sin(about)])
        return rotated(bvh, turn)

    return change


def tilting(degrees: float, about: float) -> Change:
    """Let the world tilt slowly about a horizontal axis through where the clip begins, as trackers that drift do."""

    def change(bvh: Bvh) -> Bvh:
        halves = np.deg2rad(degrees) / 2.0 * np.linspace(0.0, 1.0, bvh.frame_count)
        axis = np.array([np.cos(about), 0.0, np.sin(about)])
        turns = np.concatenate([np.cos(halves)[:, None], np.sin(halves)[:, None] * axis], axis=1)
        return rotated(bvh, turns, path_of(bvh, 0)[0] * np.array([1.0, 0.0, 1.0]))

    return change


def rotated(bvh: Bvh, turn: Array, about: Array | float = 0.0) -> Bvh:
    """Rotate the motion about the origin or another point; the rest pose stays."""
    clip = to_clip(bvh)
    rotations = clip.rotations.copy()
    rotations[:, 0] = quaternion.multiply(turn, rotations[:, 0])
    roots = quaternion.rotate(turn, clip.root_positions - about) + about
    moved = clip.translations
    if moved is not None:
        moved = moved.copy()
        moved[:, 0] = roots
    return _written(replace(clip, rotations=rotations, root_positions=roots, translations=moved), bvh)


def angles_in(factor: float) -> Change:
    """Write angles in another unit than degrees."""

    def change(bvh: Bvh) -> Bvh:
        motion = bvh.motion.copy()
        motion[:, rotation_columns(bvh)] *= factor
        return replace(bvh, motion=motion)

    return change


def some_in_radians(root: bool) -> Change:
    """Write angles of the root alone in radians, or those of all joints but the root."""

    def change(bvh: Bvh) -> Bvh:
        motion, columns = bvh.motion.copy(), rotation_columns(bvh)
        motion[:, columns[(columns < bvh.first_channels()[1]) == root]] *= np.pi / 180.0
        return replace(bvh, motion=motion)

    return change


def rows_twice(bvh: Bvh) -> Bvh:
    """Write every row twice, at twice the rate."""
    return _with_rows(rate_of(2.0 * bvh.fps)(bvh), np.repeat(bvh.motion, 2, axis=0))


def frozen_middle(bvh: Bvh) -> Bvh:
    """Hold a frame in the middle of the clip for half a second."""
    motion, middle = bvh.motion.copy(), bvh.frame_count // 2
    motion[middle : middle + round(0.5 * bvh.fps)] = motion[middle]
    return replace(bvh, motion=motion)


def named_in(order: str) -> Change:
    """Name the rotation channels of all joints in another order than that in which their numbers are."""

    def change(bvh: Bvh) -> Bvh:
        channels = []
        for names in bvh.channels:
            letters = iter(order)
            channels.append(tuple(f"{next(letters)}rotation" if name.endswith("rotation") else name for name in names))
        return replace(bvh, channels=tuple(channels))

    return change


def root_named_in(order: str) -> Change:
    """Name the rotation channels of the root alone in another order than that in which their numbers are."""
    return lambda bvh: replace(bvh, channels=(named_in(order)(bvh).channels[0], *bvh.channels[1:]))


def rotations_first(bvh: Bvh) -> Bvh:
    """Name the root's rotations before its positions, which are written first."""
    root = bvh.channels[0]
    swapped = tuple(name for kind in ("rotation", "position") for name in root if name.endswith(kind))
    return replace(bvh, channels=(swapped, *bvh.channels[1:]))


def positions_of_all(places: Callable[[Bvh, int, Array], Array]) -> Change:
    """Give every joint six channels; ``places`` says what its positions are, from world positions (F, J, 3)."""

    def change(bvh: Bvh) -> Bvh:
        clip = to_clip(bvh)
        world = clip_kinematics(clip)[0]
        still = np.broadcast_to(clip.skeleton.offsets, world.shape).copy()
        still[:, 0] = clip.root_positions
        six = _written(replace(clip, translations=still), bvh)
        motion = six.motion.copy()
        for joint in range(1, six.joint_count):
            motion[:, position_columns(six, joint)] = places(bvh, joint, world)
        return replace(six, motion=motion)

    return change


def frozen_lead(bvh: Bvh) -> Bvh:
    """Hold the first frame for a second."""
    count = round(bvh.fps)
    return _with_rows(bvh, np.concatenate([np.repeat(bvh.motion[:1], count, axis=0), bvh.motion]))


def zeros_at_the_end(bvh: Bvh) -> Bvh:
    """Add ten rows of zeros."""
    return _with_rows(bvh, np.concatenate([bvh.motion, np.zeros((10, bvh.channel_count))]))


def zeros_at_the_start(bvh: Bvh) -> Bvh:
    """Begin with ten rows of zeros but for the root's place."""
    lead = np.zeros((10, bvh.channel_count))
    columns = position_columns(bvh, 0)
    lead[:, columns] = bvh.motion[0, columns]
    return _with_rows(bvh, np.concatenate([lead, bvh.motion]))


def blended_in(seconds: float) -> Change:
    """Blend from the rest pose into the motion, as evenly in all joints as tools do."""

    def change(bvh: Bvh) -> Bvh:
        clip = to_clip(bvh)
        shares = np.minimum(np.arange(clip.frame_count) / (seconds * clip.fps), 1.0)[:, None, None]
        turns = quaternion.to_rotation_vector(clip.rotations)
        return _written(replace(clip, rotations=quaternion.from_rotation_vector(shares * turns)), bvh)

    return change


def tee_in_the_middle(bvh: Bvh) -> Bvh:
    """Hold a T-pose for a second in the middle of the clip, with a way to it and one back."""
    clip = to_clip(bvh)
    count, way = min(round(clip.fps), clip.frame_count // 4), round(0.3 * clip.fps)
    first = (clip.frame_count - count) // 2
    frames = np.arange(clip.frame_count)
    shares = np.clip(np.maximum(first - frames, frames - first - count) / way, 0.0, 1.0)[:, None, None]
    turns = quaternion.to_rotation_vector(clip.rotations)
    return _written(replace(clip, rotations=quaternion.from_rotation_vector(shares * turns)), bvh)


def still(limb: str, seconds: float | None = None) -> Change:
    """Hold all joints of a limb, named by the role that it begins with, throughout or for a while in the middle."""

    def change(bvh: Bvh) -> Bvh:
        motion = bvh.motion.copy()
        first = 0 if seconds is None else bvh.frame_count // 2
        stop = bvh.frame_count if seconds is None else first + round(seconds * bvh.fps)
        columns = _rotations_below(bvh, limb)
        motion[first:stop, columns] = motion[first, columns]
        return replace(bvh, motion=motion)

    return change


def wrong_frames(bvh: Bvh) -> Bvh:
    """Turn the left elbow by 45 degrees in every hundredth frame."""
    clip = to_clip(bvh)
    rotations, frames = clip.rotations.copy(), np.arange(50, clip.frame_count - 1, 100)
    elbow = _roles(bvh)["left_elbow"]
    turn = quaternion.from_rotation_vector(np.deg2rad(45.0) * np.array([0.0, np.sqrt(0.5), np.sqrt(0.5)]))
    rotations[frames, elbow] = quaternion.multiply(rotations[frames, elbow], turn)
    return _written(replace(clip, rotations=rotations), bvh)


def sides_confused(frames: int) -> Change:
    """Give each side's limbs the rotations of the other's for some frames, as trackers that confuse them do."""

    def change(bvh: Bvh) -> Bvh:
        motion, first = bvh.motion.copy(), bvh.frame_count // 2
        for limb in ("shoulder", "hip"):
            left, right = (_rotations_below(bvh, f"{side}_{limb}") for side in ("left", "right"))
            motion[first : first + frames, left] = bvh.motion[first : first + frames, right]
            motion[first : first + frames, right] = bvh.motion[first : first + frames, left]
        return replace(bvh, motion=motion)

    return change


def other_pose(seconds: float) -> Change:
    """Put the poses that a clip begins with into its middle, for some time, over the root's own path."""

    def change(bvh: Bvh) -> Bvh:
        motion, first, count = bvh.motion.copy(), bvh.frame_count // 2, round(seconds * bvh.fps)
        columns = rotation_columns(bvh)
        motion[first : first + count, columns] = bvh.motion[:count, columns]
        return replace(bvh, motion=motion)

    return change


def other_end(frames: int, root: bool) -> Change:
    """Begin, or end where frames are negative, with poses from the middle, or with the root away by 60 % of a leg."""

    def change(bvh: Bvh) -> Bvh:
        end = slice(0, frames) if frames > 0 else slice(frames, None)
        if root:
            path = path_of(bvh, 0)
            path[end, 0] += 0.6 * _leg(bvh)
            return with_path(bvh, 0, path)
        motion, columns, middle = bvh.motion.copy(), rotation_columns(bvh), bvh.frame_count // 2
        motion[end, columns] = bvh.motion[middle : middle + abs(frames), columns]
        return replace(bvh, motion=motion)

    return change


def root_rotation(heading: bool) -> Change:
    """Leave out the root's rotation, or all but its heading."""

    def change(bvh: Bvh) -> Bvh:
        clip = to_clip(bvh)
        rotations = clip.rotations.copy()
        ahead = quaternion.rotate(rotations[:, 0], np.array([0.0, 0.0, 1.0]))
        rotations[:, 0] = quaternion.about_y(np.arctan2(ahead[:, 0], ahead[:, 2]) if heading else np.zeros(len(ahead)))
        return _written(replace(clip, rotations=rotations), bvh)

    return change


def root_level(bvh: Bvh) -> Bvh:
    """Keep the root at one height."""
    path = path_of(bvh, 0)
    path[:, 1] = path[0, 1]
    return with_path(bvh, 0, path)


def root_late(seconds: float) -> Change:
    """Let the root go where it should be only some time later."""

    def change(bvh: Bvh) -> Bvh:
        frames = np.maximum(np.arange(bvh.frame_count) - round(seconds * bvh.fps), 0)
        return with_path(bvh, 0, path_of(bvh, 0)[frames])

    return change


def root_rises(speed: float, height: float) -> Change:
    """Let the root rise steadily, in legs a second, and sway up and down by a share of a leg within six seconds."""

    def change(bvh: Bvh) -> Bvh:
        path, seconds = path_of(bvh, 0), np.arange(bvh.frame_count) / bvh.fps
        path[:, 1] += _leg(bvh) * (speed * seconds + height * np.sin(2.0 * np.pi * seconds / 6.0))
        return with_path(bvh, 0, path)

    return change


def sides_exchanged(limb: str) -> Change:
    """Exchange names of left and right in arms or legs alone, which begin with a role."""

    def change(bvh: Bvh) -> Bvh:
        names = list(bvh.names)
        left, right = (_below(bvh, _roles(bvh)[f"{side}_{limb}"]) for side in ("left", "right"))
        for a, b in zip(left, right, strict=True):
            names[a], names[b] = names[b], names[a]
        return replace(bvh, names=tuple(names))

    return change


def rotations_in_the_world(bvh: Bvh) -> Bvh:
    """Write rotations of joints in the world instead of against their parents."""
    clip = to_clip(bvh)
    return _written(replace(clip, rotations=quaternion.continuous(clip_kinematics(clip)[1])), bvh)


_CHANNELS = {
    "displacements, all zero": lambda bvh, joint, world: np.zeros((len(world), 3)),
    "displacements of a share of a bone": lambda bvh, joint, world: np.random.default_rng(joint).normal(
        scale=0.003 * _leg(bvh), size=(len(world), 3)
    ),
    "offsets in another unit": lambda bvh, joint, world: np.repeat(0.01 * bvh.offsets[[joint]], len(world), axis=0),
    "places in the world": lambda bvh, joint, world: world[:, joint],
    "places against the root": lambda bvh, joint, world: world[:, joint] - world[:, 0],
}
FAULTS: dict[str, tuple[str, Change]] = {
    "frame time in milliseconds": ("time_base", timed_in(lambda fps: 1e3 / fps)),
    "frame time in microseconds": ("time_base", timed_in(lambda fps: 1e6 / fps)),
    "frames per second for a frame time": ("time_base", timed_in(lambda fps: fps)),
    "frame time a thousand times too short": ("time_base", timed_in(lambda fps: 1e-3 / fps)),
    "frame rate twice as high": ("time_base", lambda bvh: rate_of(2.0 * bvh.fps)(bvh)),
    "frame rate half as high": ("time_base", lambda bvh: rate_of(0.5 * bvh.fps)(bvh)),
    "frame rate 5 times too high": ("time_base", lambda bvh: rate_of(5.0 * bvh.fps)(bvh)),
    "frame rate 4 times too low": ("time_base", lambda bvh: rate_of(0.25 * bvh.fps)(bvh)),
    "root in m, bones in cm": ("root_path", root_scaled(0.01)),
    "root in mm, bones in cm": ("root_path", root_scaled(10.0)),
    "root in inches, bones in cm": ("root_path", root_scaled(1.0 / 2.54)),
    "root in cm, bones in inches": ("root_path", bones_in_inches),
    "root in inches, bones in m": ("root_path", lambda bvh: root_scaled(39.37)(in_metres(bvh))),
    "root with z up, bones with y up": ("root_path", root_exchanged),
    "root as displacements of each frame": ("root_path", root_displacements),
    "root goes half as far": ("root_path", root_scaled(0.5)),
    "root goes twice as far": ("root_path", root_scaled(2.0)),
    "root a quarter of a second late": ("root_path", root_late(0.25)),
    "root steps": ("root_jumps", root_step),
    "root at the origin for 6 frames": ("root_jumps", root_at_origin),
    "6 rows of zeros": ("root_jumps", rows_of_zeros),
    "left and right confused for 5 frames": ("pose_jumps", sides_confused(5)),
    "poses of another time for half a second": ("pose_jumps", other_pose(0.5)),
    "poses of another time in the first frame": ("ends", other_end(1, False)),
    "poses of another time in the last frame": ("ends", other_end(-1, False)),
    "poses of another time in the last 3 frames": ("ends", other_end(-3, False)),
    "root elsewhere in the first frame": ("root_jumps", other_end(1, True)),
    "root elsewhere in the last frame": ("root_jumps", other_end(-1, True)),
    "root elsewhere in the first 3 frames": ("root_jumps", other_end(3, True)),
    "root held for 5 frames": ("root_held", root_held),
    "root drifts": ("root_drift", root_drifting(0.4)),
    "root drifts slowly": ("root_drift", root_drifting(0.2)),
    "root rises": ("floor", root_rises(0.1, 0.0)),
    "root sways up and down": ("floor", root_rises(0.0, 0.25)),
    "root does not travel": ("in_place", in_place),
    "root keeps its height": ("in_place", root_level),
    "root without rotations": ("limbs", root_rotation(False)),
    "root without rotations but its heading": ("limbs", root_rotation(True)),
    "an arm was not captured": ("limbs", still("left_shoulder")),
    "a leg was not captured": ("limbs", still("right_hip")),
    "an arm was lost for a second": ("limbs", still("left_shoulder", 1.0)),
    "single frames of an elbow are wrong": ("spins", wrong_frames),
    "left-handed": ("handedness", left_handed),
    "names of left and right exchanged in the arms": ("sides", sides_exchanged("shoulder")),
    "names of left and right exchanged in the legs": ("sides", sides_exchanged("hip")),
    "tilted by 10 degrees": ("tilt", tilted(10.0, 2.8)),
    "tilted by 12 degrees": ("tilt", tilted(12.0, 0.4)),
    "tilted by 25 degrees": ("tilt", tilted(25.0, 2.0)),
    "tilts slowly by 15 degrees": ("tilt", tilting(15.0, 1.0)),
    "tilts slowly by 25 degrees": ("tilt", tilting(25.0, 2.5)),
    "angles in radians": ("angles", angles_in(np.pi / 180.0)),
    "angles of all joints but the root in radians": ("angles", some_in_radians(False)),
    "angles of the root alone in radians": ("angles", some_in_radians(True)),
    "angles in turns": ("angles", angles_in(1.0 / 360.0)),
    "angles converted twice": ("angles", angles_in(180.0 / np.pi)),
    "angles in the opposite sense": ("rotations", angles_in(-1.0)),
    "rotations named in reverse order": ("rotations", named_in("YXZ")),
    "rotations named in the order XYZ": ("rotations", named_in("XYZ")),
    "rotations of the root alone named in the order XYZ": ("rotations", root_named_in("XYZ")),
    "rotations are those in the world": ("rotations", rotations_in_the_world),
    "root's positions and rotations exchanged": ("rotations", rotations_first),
    **{f"positions are {name}": ("channels", positions_of_all(places)) for name, places in _CHANNELS.items()},
    "every row twice": ("repeats", rows_twice),
    "frozen for half a second": ("repeats", frozen_middle),
    "a frozen second at the start": ("ends", frozen_lead),
    "a blend of 0.1 s from a T-pose": ("ends", blended_in(0.1)),
    "a blend of 0.5 s from a T-pose": ("ends", blended_in(0.5)),
    "a T-pose for a second in the middle": ("ends", tee_in_the_middle),
    "10 rows of zeros at the start": ("ends", zeros_at_the_start),
    "10 rows of zeros at the end": ("ends", zeros_at_the_end),
}
"""The fault that is made, by its name: the kind that is to be found, and the change that makes it."""


def clean_twins(clip: Clip, body: Body, unit: float = 0.01) -> Iterator[tuple[str, Bvh]]:
    """Yield a clean clip as a file, and versions of it that are as clean: mirrored, scaled, rotated and re-timed."""
    plain = from_clip(clip, unit_scale=unit)
    yield "as it is", plain
    yield "mirrored", from_clip(mirrored(clip, body), unit_scale=unit)
    for factor in (0.75, 1.25):
        roots = clip.root_positions * factor
        moved = None if clip.translations is None else clip.translations * factor
        scaled = replace(clip, skeleton=clip.skeleton.scaled(factor), root_positions=roots, translations=moved)
        ends = replace(scaled.skeleton, end_offsets=clip.skeleton.end_offsets * factor)
        yield f"{factor:g} times as large", from_clip(replace(scaled, skeleton=ends), unit_scale=unit)
    yield "rotated by 120 degrees", rotated(plain, quaternion.about_y(np.deg2rad(120.0)))
    half = np.sqrt(0.5)
    yield "with z up", rotated(plain, np.array([half, half, 0.0, 0.0]))
    for factor in (0.6, 1.5):
        yield f"{factor:g} times as fast", replace(plain, fps=plain.fps * factor, frame_time=plain.frame_time / factor)
    yield "every second frame", _with_rows(rate_of(plain.fps / 2.0)(plain), plain.motion[::2])


def _roles(bvh: Bvh) -> dict[str, int]:
    return find_roles(to_clip(bvh).skeleton)


def _below(bvh: Bvh, top: int) -> list[int]:
    """A joint and all that hang on it, in file order."""
    found = {top}
    for joint in range(top + 1, bvh.joint_count):
        if int(bvh.parents[joint]) in found:
            found.add(joint)
    return sorted(found)


def _rotations_below(bvh: Bvh, role: str) -> Array:
    columns, starts = rotation_columns(bvh), bvh.first_channels()
    joints = _below(bvh, _roles(bvh)[role])
    return columns[np.isin(np.searchsorted(starts, columns, side="right") - 1, joints)]


def _leg(bvh: Bvh) -> float:
    """Length of all bones along the longest chain, about that of a leg and a trunk, halved."""
    depth = np.zeros(bvh.joint_count)
    for joint, parent in enumerate(bvh.parents):
        if parent >= 0:
            depth[joint] = depth[parent] + np.linalg.norm(bvh.offsets[joint])
    return 0.5 * float(depth.max())


def _with_rows(bvh: Bvh, rows: Array) -> Bvh:
    return replace(bvh, motion=np.ascontiguousarray(rows), declared_frames=len(rows))


def _written(clip: Clip, like: Bvh) -> Bvh:
    written = from_clip(clip, unit_scale=1.0)
    return replace(written, fps=like.fps, frame_time=like.frame_time)
