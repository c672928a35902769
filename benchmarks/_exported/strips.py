"""Strips of the worst moments of a run and of typical ones: bodies as its BVH files pose them, drawn by the package."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from _exported.goals import find
from _exported.plain_bvh import Array, pose, read_plain
from _exported.run import ExportedRun
from crowdsim.body.palette import avatar_paints
from crowdsim.policy.bundle import load_policy
from crowdsim.render.caption import draw_caption
from crowdsim.render.figure import Figure, dress
from crowdsim.render.raycast import Capsules, draw, sun_direction
from crowdsim.render.view import look_at

TILES = 9
"""Frames in a strip."""
TILE = (190, 210)
"""Width and height of a frame [px]."""
COLOURS = np.array([[0.62, 0.3, 0.22], [0.25, 0.36, 0.6]])
"""Of the avatar that a moment belongs to, and of the other one."""


@dataclass(frozen=True)
class Kind:
    """What strips are drawn of.

    Attributes:
        name: Of the picture.
        keys: Of the moments in a run's results.
        before: Time before the moment at which a strip begins [s].
        after: Time after it at which it ends [s].
        scale: Factor from value to caption.
        unit: Unit in the caption.
        height: Height of the middle of the picture [m].
        field: Angle between its upper and lower edge [rad].
    """

    name: str
    keys: tuple[str, ...]
    before: float
    after: float
    scale: float
    unit: str
    height: float = 0.9
    field: float = math.radians(24.0)


LEGS = (0.42, math.radians(11.0))
"""Height and field of pictures of legs."""
KINDS = (
    Kind("penetration", ("bodies", "without_arms", "moments"), 0.4, 0.4, 100.0, "cm"),
    Kind("arms", ("bodies", "arm_in_trunk_or_head", "moments"), 0.4, 0.4, 100.0, "cm"),
    Kind("strikes", ("strikes", "moments"), 0.4, 0.4, 100.0, "cm"),
    Kind("feet", ("accelerations", "linear", "foot", "moments"), 0.134, 0.134, 1.0, "times the limit", *LEGS),
    Kind("ankles", ("accelerations", "angular", "foot", "moments"), 0.134, 0.134, 1.0, "times the limit", *LEGS),
    Kind("hands", ("accelerations", "linear", "hand", "moments"), 0.134, 0.134, 1.0, "times the limit"),
    Kind("wrists", ("accelerations", "angular", "hand", "moments"), 0.134, 0.134, 1.0, "times the limit"),
    Kind("jumps", ("jumps", "rotation_moments"), 0.067, 0.067, 1.0, "degrees"),
    Kind("drops", ("jumps", "pelvis_moments"), 0.134, 0.134, 100.0, "cm"),
    Kind("gaze", ("gaze", "moments"), 0.8, 0.8, 1.0, "degrees"),
    Kind("behind", ("gaze", "behind_moments"), 0.2, 1.0, 1.0, "degrees"),
    Kind("reactions", ("reactions", "moments"), 0.1, 0.7, 100.0, "cm towards the fist"),
    Kind("blows", ("blows", "moments"), 0.1, 0.9, 1.0, "kg m/s that do not show"),
    Kind("typical_blows", ("blows", "typical"), 0.1, 0.9, 1.0, "kg m/s that do not show"),
    Kind("equal_strikes", ("variety", "moments"), 0.4, 0.4, 1.0, "s apart"),
)


def draw_strips(folder: Path, bundle: Path, run: ExportedRun, results: dict[str, Any], out: Path) -> None:
    """Draw the worst moments of each kind, and the most typical blows.

    Args:
        folder: The run's folder.
        bundle: Its policy's bundle.
        run: The run.
        results: Its figures.
        out: Folder of the pictures, ``RUN_KIND.png``; it is made.
    """
    out.mkdir(parents=True, exist_ok=True)
    body = dress(load_policy(bundle).database.body)
    paths = [folder / "bvh" / f"{name}.bvh" for name in run.names]
    # Files are read again for what few frames show; figures hold no eyes and noses.
    for kind in KINDS:
        moments = find(results, kind.keys) or []
        rows = [draw_moment(paths, body, run, kind, moment) for moment in moments]
        if rows:
            picture = Image.fromarray(np.concatenate(rows)).quantize(200, dither=Image.Dither.NONE)
            picture.save(out / f"{folder.name}_{kind.name}.png", optimize=True)


def draw_moment(paths: list[Path], body: Figure, run: ExportedRun, kind: Kind, moment: dict[str, Any]) -> Array:
    """Draw frames around a moment, from the side of its avatar or of the two. Shape (height, width, 3), uint8."""
    avatar, other, frame = moment["avatar"], moment.get("other"), moment["frame"]
    times = np.linspace(-kind.before, kind.after, TILES)
    frames = np.clip(np.round(frame + times * run.fps).astype(int), 0, run.count - 1)
    who = [avatar] if other is None else [avatar, other]
    pelvises = np.stack([run.figures[k].joints[:, 0] for k in who])
    middle = pelvises[:, frame].mean(axis=0) * [1.0, 0.0, 1.0] + [0.0, kind.height, 0.0]
    way = pelvises[1, frame] - pelvises[0, frame] if other is not None else run.figures[avatar].pelvises[frame]
    azimuth = math.atan2(way[0], way[2]) + 0.5 * math.pi
    eye = middle + 5.4 * np.array([math.sin(azimuth), 0.12, math.cos(azimuth)])
    shapes = [_capsules(paths[k], body, float(run.scales[k]), frames) for k in who]
    paints = avatar_paints(np.arange(len(who)), COLOURS[: len(who)])
    colours = np.concatenate([paints[k][body.capsule_parts] for k in range(len(who))]).astype(np.float32)
    owners = np.repeat(np.arange(len(who)), len(body.capsule_parts)).astype(np.int32)
    tiles = []
    for at in range(TILES):
        capsules = Capsules(np.concatenate([one[at] for one in shapes]), colours, owners)
        size = (2 * TILE[0], 2 * TILE[1])
        large = draw(capsules, look_at(eye, middle, field=kind.field), size, sun_direction(azimuth + 0.7), threads=1)
        tile = large.reshape(TILE[1], 2, TILE[0], 2, 3).mean(axis=(1, 3)).astype(np.uint8)
        draw_caption(tile, f"{(frames[at] - frame) / run.fps:+.2f}", corner=(5, TILE[1] - 16), height=11)
        tiles.append(tile)
    strip = np.concatenate(tiles, axis=1)
    names = " and ".join(paths[k].stem for k in who)
    value = f"{kind.scale * moment['value']:.3g} {kind.unit}"
    draw_caption(strip, f"{names}, {frame / run.fps:.2f} s: {value} {moment.get('parts', '')}", (5, 3), 13)
    return strip


def _capsules(path: Path, body: Figure, scale: float, frames: Array) -> Array:
    """Capsules of a body at frames of its file. Shape (n, K, 8), float32: both ends and radii."""
    bvh = read_plain(path, frames)
    positions, turns = pose(bvh)
    joints = body.capsule_joints
    ends = [
        positions[:, joints] + np.einsum("fkij,kj->fki", turns[:, joints], np.asarray(offsets) * scale)
        for offsets in (body.capsule_starts, body.capsule_ends)
    ]
    radii = np.broadcast_to(np.asarray(body.capsule_radii) * scale, (len(frames), len(joints), 2))
    return np.concatenate([*ends, radii], axis=2).astype(np.float32)
