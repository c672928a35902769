"""Draws docs/performer.png: every kind of move of the embedded boxer, from the side and from the front.

    python docs/performer_sheet.py [PICTURE]

Each row is one move alone, out of the guard and back, by moments that are evenly spaced (times in seconds); left from
the side, right from the front. The boxer is orthodox, his left side leads and his left glove is the red one.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from crowdsim.motion.body import PARTS, build_body
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.performer.moves import DEFENCES, PUNCHES
from crowdsim.performer.rests import RESTS
from crowdsim.performer.session import Performance, perform_solo
from crowdsim.performer.solo import FOOTWORK
from crowdsim.render.caption import draw_caption
from crowdsim.render.raycast import Capsules, draw, sun_direction
from crowdsim.render.scene import build_cast
from crowdsim.render.view import look_at

MOMENTS = 7
TILE = (112, 150)
LEFT_OUT = {move for move in FOOTWORK if move.startswith("shuffle") and move.count("_") == 2} | {
    "walk_curve",
    "jog_curve",
    "walk_to_jog_to_walk",
}
"""Footwork that looks like other rows: shuffles on diagonals, and curves."""
_GAP = 10
_RED, _BLUE = (0.62, 0.03, 0.03), (0.03, 0.09, 0.55)


def draw_performer_sheet(path: Path, seed: int = 7, threads: int = 2) -> None:
    """Draw the sheet into a PNG file of some 2,000 pixels, for ``make docs-pictures``."""
    footwork = [move for move in FOOTWORK if move not in LEFT_OUT]
    rows = [_draw_move(move, seed, threads) for move in (*PUNCHES, *DEFENCES, *footwork, *RESTS)]
    picture = Image.fromarray(np.concatenate(rows)).quantize(200, dither=Image.Dither.NONE)
    temporary = path.with_name(f".{path.name}")
    picture.save(temporary, format="PNG", optimize=True)
    temporary.replace(path)


def _draw_move(move: str, seed: int, threads: int) -> np.ndarray:
    performance = perform_solo(move, seed)
    clip = performance.clip
    first, last = _span(performance)
    positions, rotations = clip_kinematics(clip)
    frames = np.unique(np.linspace(first, last, MOMENTS).round().astype(int))
    body = build_body(clip.skeleton)
    cast = build_cast([body], np.zeros(1, np.int32), [0], colours=np.array([[0.55, 0.58, 0.62]]))
    paints = cast.paints.copy()
    for capsule, joint in enumerate(body.capsule_joints):
        if PARTS[body.capsule_parts[capsule]] == "glove":
            paints[capsule, :3] = _RED if clip.skeleton.names[joint].startswith("Left") else _BLUE
    # The camera stays where it is, but goes along with a boxer who would leave the picture.
    middles = np.tile(positions[frames, 0].mean(axis=0), (len(frames), 1))
    if np.ptp(positions[frames, 0][:, [0, 2]], axis=0).max() > 0.8:
        middles = positions[frames, 0].copy()
    middles[:, 1] = 0.84
    strips = []
    for azimuth in (-0.5 * math.pi, 0.0):
        tiles = []
        for frame, target in zip(frames, middles, strict=True):
            eye = target + 5.6 * np.array([math.sin(azimuth), 0.16, math.cos(azimuth)])
            capsules = cast.place([(positions[frame : frame + 1], rotations[frame : frame + 1])])
            large = draw(
                Capsules(capsules.shapes, paints, capsules.owners),
                look_at(eye, target, field=math.radians(20.0)),
                (2 * TILE[0], 2 * TILE[1]),
                sun_direction(azimuth + 0.7),
                threads=threads,
            ).astype(np.uint16)
            small = (large[::2, ::2] + large[1::2, ::2] + large[::2, 1::2] + large[1::2, 1::2] + 2) // 4
            tile = small.astype(np.uint8)
            draw_caption(tile, f"{(frame - first) / clip.fps:.2f}", height=11)
            tiles.append(tile)
        strips.append(np.concatenate(tiles, axis=1))
    gap = np.full((TILE[1], _GAP, 3), 245, np.uint8)
    row = np.concatenate([strips[0], gap, strips[1]], axis=1)
    draw_caption(row, move.replace("_", " "), corner=(5, 3), height=15)
    return np.concatenate([row, np.full((3, row.shape[1], 3), 245, np.uint8)])


def _span(performance: Performance) -> tuple[int, int]:
    """First and last frame in which something happens."""
    fps, truth = performance.clip.fps, performance.truth
    if truth.strikes:
        strike = truth.strikes[0]
        return round(strike.start * fps) - 9, round(strike.end * fps) + 9
    if truth.defences:
        return truth.defences[0].start, truth.defences[0].end - 1
    if truth.rests:
        return truth.rests[0].start - 6, truth.rests[0].end + 6
    moving = np.flatnonzero(~truth.contacts.all(axis=1))
    return int(moving[0]) - 2, int(moving[-1]) + 6


if __name__ == "__main__":
    draw_performer_sheet(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "performer.png")
