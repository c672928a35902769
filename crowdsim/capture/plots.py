"""Pictures of a capture: skeleton with roles, root path, contacts, fist speeds, stick figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.capture.loading import Capture
from crowdsim.core.types import Array
from crowdsim.figures import new_figure, save_figure
from crowdsim.motion import ground, quaternion
from crowdsim.motion.analysis import ClipAnalysis
from crowdsim.motion.body import HEIGHT, ROLES
from crowdsim.motion.contacts import runs
from crowdsim.motion.kicks import foot_speed
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import rests_like_a_body, sample_poses
from crowdsim.motion.skeleton import Skeleton
from crowdsim.motion.strikes import HANDS, HANDS_AND_FEET, LIMBS, MINIMUM_SPEED, REASONS, Rejection, fist_speed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_SIDES = ("left", "right")
_COLOURS = ("tab:blue", "tab:red")
_NEUTRAL = "0.25"
_FIGURES = 12


def plot_capture(capture: Capture, folder: Path) -> list[Path]:
    """Write the pictures that a capture allows into a folder, and return their paths."""
    figures = {"skeleton": skeleton_figure(capture)}
    analysis = capture.analysis
    if analysis is not None:
        figures["path"] = path_figure(analysis)
        figures["time"] = time_figure(analysis, capture.start)
        figures["figures"] = pose_figure(analysis, capture.start)
    name = capture.clip.name
    return [save_figure(figure, folder / f"{name}_{part}.png") for part, figure in figures.items()]


def _joint_colour(skeleton: Skeleton, roles: Mapping[str, int], joint: int) -> str:
    """Blue under a left limb's root, red under a right one's."""
    tops = {roles.get(f"{side}_{part}"): side for side in _SIDES for part in ("hip", "shoulder")}
    while joint >= 0:
        if joint in tops:
            return _COLOURS[_SIDES.index(tops[joint])]
        joint = int(skeleton.parents[joint])
    return _NEUTRAL


def skeleton_figure(capture: Capture) -> Figure:
    """Draw the body from the front and the side; the front names the limbs, the side the trunk, in the margins."""
    figure = new_figure(20, 6)
    skeleton, body = capture.clip.skeleton, capture.body
    positions, ends, what = _shown_pose(capture)
    for axes, view in zip(figure.subplots(1, 2), ("front", "side"), strict=True):
        # From the front the figure's left is on the viewer's right, from the side it looks to the right.
        across = 0 if view == "front" else 2
        for joint, parent in enumerate(skeleton.parents):
            colour = _joint_colour(skeleton, capture.roles, joint)
            if parent >= 0:
                bone = positions[[parent, joint]]
                axes.plot(bone[:, across], bone[:, 1], color=colour, lw=1.5)
            axes.plot(positions[joint, across], positions[joint, 1], "o", ms=3, color=colour)
        for parent, end in zip(skeleton.end_parents, ends, strict=True):
            bone = np.stack([positions[parent], end])
            axes.plot(bone[:, across], bone[:, 1], ":", color=_joint_colour(skeleton, capture.roles, int(parent)), lw=1)
        _name_roles(axes, capture, positions, view)
        # Both views have one scale, with room for names beside.
        middle = 0.5 * (positions.min(axis=0) + positions.max(axis=0))
        size = max(float(np.ptp(positions, axis=0).max()), 1e-6)
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlim(middle[across] - 1.3 * size, middle[across] + 1.3 * size)
        axes.set_ylim(middle[1] - 0.62 * size, middle[1] + 0.62 * size)
        axes.set_title(f"{what}, {view}")
        unit = "[m]" if capture.unit_scale else "[file units]"
        axes.set_xlabel(f"{'to its left' if view == 'front' else 'ahead'} {unit}")
        axes.set_ylabel(f"height over the root {unit}")
    axis, scale = capture.up_axis or "unknown", capture.unit_scale
    figure.suptitle(
        f"{capture.clip.name}: {skeleton.joint_count} joints, up axis {axis}, "
        + (f"{scale:.6g} m a unit" if scale else "unknown scale")
        + (f", {body.height:.2f} m tall" if body else "" if capture.roles else ", no human body")
    )
    return figure


def _shown_pose(capture: Capture) -> tuple[Array, Array, str]:
    """Joints (J, 3) and end sites (E, 3) of the pose that is drawn, facing +z, and what pose it is."""
    skeleton, roles = capture.clip.skeleton, capture.roles
    positions = skeleton.rest_positions() - skeleton.offsets[0]
    joint_rotations, what = None, "rest pose"
    if roles:
        samples, rotations = sample_poses(capture.motion)
        feet = [roles["left_foot"], roles["right_foot"]]
        rise = positions[roles["head"], 1] - positions[feet, 1].mean()
        if len(samples) and (not rests_like_a_body(skeleton, roles) or rise < 0.4 * np.ptp(positions, axis=0).max()):
            frame = int(np.argmax(samples[:, roles["head"], 1] - samples[:, feet, 1].mean(axis=1)))
            positions, joint_rotations = samples[frame] - samples[frame, 0], rotations[frame]
            what = "standing (the rest pose is none)"
    ends = (
        skeleton.end_offsets
        if joint_rotations is None
        else quaternion.rotate(joint_rotations[skeleton.end_parents], skeleton.end_offsets)
    )
    ends = positions[skeleton.end_parents] + ends
    if roles:
        across = positions[roles["left_hip"]] - positions[roles["right_hip"]]
        facing = np.array([0.0, 0.0, np.arctan2(-across[2], across[0])])
        positions, ends = ground.to_local(facing, positions), ground.to_local(facing, ends)
    return positions, ends, what


def _name_roles(axes: Any, capture: Capture, positions: Array, view: str) -> None:
    """Write roles and joint names into the margins, each with a line to its joint, spread so that none overlap."""
    roles, names = capture.roles, capture.clip.skeleton.names
    across = 0 if view == "front" else 2
    low, high = float(positions[:, 1].min()), float(positions[:, 1].min() + max(np.ptp(positions[:, 1]), 1e-6))
    reach = float(np.abs(positions[:, across]).max(initial=0.0)) + 0.08 * (high - low)
    if view == "front":
        margins = {1.0: [r for r in roles if r.startswith("left")], -1.0: [r for r in roles if r.startswith("right")]}
    else:
        margins = {1.0: [role for role in roles if not role.startswith(("left", "right"))]}
    for sign, chosen in margins.items():
        # Level arms are named from the shoulder outwards.
        chosen = sorted(
            chosen, key=lambda role: (-round(positions[roles[role], 1] / (0.06 * (high - low))), ROLES.index(role))
        )
        heights = _spread(positions[[roles[role] for role in chosen], 1], 0.055 * (high - low))
        for role, height in zip(chosen, heights, strict=True):
            position = positions[roles[role]]
            axes.annotate(
                f"{role}: {names[roles[role]]}",
                (position[across], position[1]),
                xytext=(sign * reach, height),
                fontsize=8,
                color=_joint_colour(capture.clip.skeleton, roles, roles[role]),
                ha="left" if sign > 0 else "right",
                va="center",
                arrowprops={"arrowstyle": "-", "color": "0.75", "lw": 0.6, "shrinkA": 2, "shrinkB": 2},
            )


def _spread(heights: Array, gap: float) -> Array:
    """Move falling heights apart to at least ``gap``, about their own middle."""
    spread = np.array(heights, dtype=float)
    for index in range(1, len(spread)):
        spread[index] = min(spread[index], spread[index - 1] - gap)
    return spread + (np.mean(heights) - np.mean(spread) if len(spread) else 0.0)


def path_figure(analysis: ClipAnalysis) -> Figure:
    """Draw the path of the pelvis from above, with its heading every second, and the planted feet.

    Seen from above, with z to the right, x points up: neither axis is reversed.
    """
    figure = new_figure(8, 7)
    axes = figure.subplots()
    path = analysis.tracks.ground
    axes.plot(path[:, 1], path[:, 0], color=_NEUTRAL, lw=1, label="pelvis")
    every = path[:: round(analysis.clip.fps)]
    axes.quiver(every[:, 1], every[:, 0], np.cos(every[:, 2]), np.sin(every[:, 2]), width=0.004, scale=22)
    for foot, (side, colour) in enumerate(zip(_SIDES, _COLOURS, strict=True)):
        planted = analysis.tracks.balls[analysis.contacts[:, foot], foot]
        axes.plot(planted[:, 2], planted[:, 0], ".", ms=3, color=colour, alpha=0.4, label=f"{side} foot planted")
    axes.plot(path[0, 1], path[0, 0], "o", color="tab:green", label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    axes.set_xlabel("z [m]")
    axes.set_ylabel("x [m]")
    axes.set_title("path of the pelvis from above, facing once a second")
    axes.legend(fontsize=8, loc="best")
    return figure


def time_figure(analysis: ClipAnalysis, start: float) -> Figure:
    """Draw contacts, and speeds with strikes and rejected swings marked, of motion that begins at a time [s].

    Speeds are those of fists, and of feet that kick.
    """
    figure = new_figure(14, 8)
    strips, speeds = figure.subplots(2, 1, sharex=True, height_ratios=[1, 5])
    seconds = start + np.arange(analysis.clip.frame_count) / analysis.clip.fps
    for foot, colour in enumerate(_COLOURS):
        for begin, end in runs(analysis.contacts[:, foot]):
            strips.barh(1 - foot, (end - begin) / analysis.clip.fps, left=seconds[begin], height=0.7, color=colour)
    slowest = MINIMUM_SPEED * analysis.body.height / HEIGHT
    strips.set_yticks([1, 0], ["left foot", "right foot"])
    strips.set_title("planted")
    for limb in HANDS_AND_FEET:
        ours, colour, side = analysis.strikes.limbs == limb, _COLOURS[limb % 2], limb % 2
        if limb not in HANDS and not ours.any():
            continue
        speed = (fist_speed if limb in HANDS else foot_speed)(analysis.tracks, side, analysis.clip.fps)
        name, style = LIMBS[limb].replace("_hand", " fist").replace("_", " "), "-" if limb in HANDS else "--"
        speeds.plot(seconds, speed, color=colour, lw=0.9, ls=style, label=name)
        speeds.plot(seconds[analysis.strikes.peaks[ours]], analysis.strikes.speeds[ours], "v", color=colour, ms=7)
        for frame in analysis.strikes.frames[ours]:
            speeds.axvline(seconds[frame], color=colour, lw=0.6, ls=":")
    speeds.axhline(slowest, color=_NEUTRAL, lw=0.7, ls="--", label="least speed of a fist that strikes")
    _mark_rejected(speeds, analysis, seconds)
    strikes, swings = len(analysis.strikes.frames), len(analysis.strikes.rejected.peaks)
    speeds.set_title(
        f"{strikes} strikes: peak (triangle), furthest reach (dotted); {swings} fast swings are none, marked by reason"
    )
    speeds.set_xlabel("time in the file [s]")
    speeds.set_ylabel("speed relative to the pelvis [m/s]")
    speeds.set_xlim(seconds[0], max(seconds[-1], seconds[0] + 0.1))
    highest = max(analysis.strikes.highest_speed, slowest, float(analysis.strikes.speeds.max(initial=0.0)))
    speeds.set_ylim(0.0, 1.05 * highest)
    figure.legend(*speeds.get_legend_handles_labels(), fontsize=8, loc="outside lower center", ncols=4)
    return figure


def _mark_rejected(axes: Any, analysis: ClipAnalysis, seconds: Array) -> None:
    """Mark fast swings that are no strikes, a shape for each reason, in the colour of the side."""
    rejected = analysis.strikes.rejected
    for reason, marker in zip(Rejection, "xs+do^v", strict=True):
        mine = rejected.reasons == reason
        if not mine.any():
            continue
        edges = [_COLOURS[limb % 2] for limb in rejected.limbs[mine]]
        faces = edges if marker in "x+" else "none"
        at = seconds[rejected.peaks[mine]], rejected.speeds[mine]
        axes.scatter(*at, s=45, marker=marker, edgecolors=None if marker in "x+" else edges, facecolors=faces, lw=1.4)
        text = f"no strike, {REASONS[reason]} ({int(mine.sum())})"
        axes.plot([], [], marker, color=_NEUTRAL, markerfacecolor="none", ms=6, label=text)


def pose_figure(analysis: ClipAnalysis, start: float) -> Figure:
    """Draw stick figures of motion that begins at a time [s] from the side and the front, each in its ground frame."""
    skeleton, (joints, _) = analysis.clip.skeleton, clip_kinematics(analysis.clip)
    figure = new_figure(16, 5.5)
    frames = np.unique(np.linspace(0, analysis.clip.frame_count - 1, _FIGURES).round().astype(int))
    spacing = max(0.1, round(0.75 * float(joints[..., 1].max(initial=1.0)), 1))
    for axes, view in zip(figure.subplots(2, 1), ("side, facing right", "front"), strict=True):
        for column, frame in enumerate(frames):
            local = ground.to_local(analysis.tracks.ground[frame], joints[frame])
            across = column * spacing + (local[:, 2] if view.startswith("side") else local[:, 0])
            for joint, parent in enumerate(skeleton.parents):
                if parent >= 0:
                    axes.plot(
                        across[[parent, joint]],
                        local[[parent, joint], 1],
                        color=_joint_colour(skeleton, analysis.body.roles, joint),
                        lw=1.3,
                        solid_capstyle="round",
                    )
        axes.axhline(0.0, color="0.6", lw=0.8)
        axes.set_aspect("equal")
        axes.set_title(view, fontsize=9)
        times = [f"{start + frame / analysis.clip.fps:.2f}" for frame in frames]
        axes.set_xticks(np.arange(len(frames)) * spacing, times)
        axes.set_xlabel(f"time in the file [s]; figures are drawn {spacing:g} m apart")
        axes.set_ylabel("height [m]")
    return figure
