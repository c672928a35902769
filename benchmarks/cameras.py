"""Cameras: how much pictures show of strikes that land.

    python benchmarks/cameras.py [--json] [--quick]

Of strikes that land in `duel` and `bout`, 200 are drawn at random, of as many seeds as it takes. Each is seen by the
camera that `render` takes by default (`auto`), and by one that looks from aside, at the frame at which the strike
reaches furthest, in a picture of 1280 x 720 pixels. Two shares of pixels are counted, by rays through the middles of
pixels against all capsules of both bodies: of the pixels that the glove would have alone, those at which nothing is
before it; and likewise of the face, the part of the head within 70 degrees of where it looks. A face that is turned
away so far that it has less than a quarter of the pixels that it would have straight on counts as if it had that many:
from behind it is hidden, in profile it is not. A strike is seen where both shares are a half at the least.

`cuts_per_minute` and `turns` say how calm the camera is: cuts, and degrees per second that it turns around the middle
of both avatars, at the median and in one of a hundred frames.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from _quick import command_line, small_policies

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.body import PARTS, Body
from crowdsim.poses.facing import face_direction
from crowdsim.render.camera import Track, build_track
from crowdsim.render.scene import build_cast
from crowdsim.render.take_source import TakeSource
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario

SCENES = ("duel", "bout")
CAMERAS = ("auto", "side")
STRIKES, FPS, SIZE = 200, 30.0, (1280, 720)
FACE = math.radians(70.0)
PROFILE = 0.25
HALF = 0.5
CUT = math.radians(15.0)
"""A view that turns so far from one frame to the next has been cut [rad]."""


def first_hits(origin: Array, rays: Array, shapes: Array) -> Array:
    """Return how far along each ray (R, 3) each rounded cone (K, 8) is met; infinite where it is not. Shape (R, K).

    Exact for capsules of one radius, which a rounded cone is at the point of its axis that is nearest to the ray.
    """
    start, along = shapes[:, :3], shapes[:, 3:6] - shapes[:, :3]
    offset = origin - start
    length = np.maximum((along * along).sum(axis=1), 1e-12)
    way = rays @ along.T
    d, e = rays @ offset.T, (offset * along).sum(axis=1)
    denominator = length - way * way
    t = np.clip(np.where(denominator > 1e-9, (e - way * d) / np.maximum(denominator, 1e-9), 0.0), 0.0, 1.0)
    s = t * way - d
    gap = offset - t[..., None] * along + s[..., None] * rays[:, None]
    radius = shapes[:, 6] + t * (shapes[:, 7] - shapes[:, 6])
    inside = radius**2 - (gap * gap).sum(axis=-1)
    return np.where((inside > 0.0) & (s > 0.0), s - np.sqrt(np.maximum(inside, 0.0)), np.inf)


def seen_shares(view: Any, shapes: Array, limb: int, head: int, of_head: Array, ahead: Array) -> tuple[float, float]:
    """Return the shares of a glove's and of a face's pixels that a view shows."""
    camera = view.pack(*SIZE)
    basis, origin = camera[3:12].reshape(3, 3), camera[:3]
    centre, radius = shapes[head, :3], float(shapes[head, 6])
    glove = _pixels(camera, basis, origin, shapes[limb])
    rays = glove @ basis
    alone = np.isfinite(first_hits(origin, rays, shapes[[limb]])[:, 0])
    rays = rays[alone]
    found = first_hits(origin, rays, shapes)
    limb_share = float((found.argmin(axis=1) == limb).mean()) if len(rays) else 0.0
    rays = _pixels(camera, basis, origin, shapes[head]) @ basis
    # Where each ray enters the head.
    to = centre - origin
    middle = rays @ to
    half = np.sqrt(np.maximum(radius**2 - (to @ to - middle**2), 0.0))
    hit = half > 0.0
    rays, middle, half = rays[hit], middle[hit], half[hit]
    face = ((origin + (middle - half)[:, None] * rays - centre) / radius @ ahead) > math.cos(FACE)
    others = np.delete(shapes, of_head, axis=0)
    free = first_hits(origin, rays, others).min(axis=1) > middle - half
    whole = max(float(np.count_nonzero(face)), PROFILE * math.sin(FACE) ** 2 * len(rays), 1.0)
    return limb_share, float(np.count_nonzero(face & free) / whole)


def _pixels(camera: Array, basis: Array, origin: Array, shape: Array) -> Array:
    """Return unit rays in the axes of the camera through the pixels around a capsule. Shape (R, 3)."""
    ends = np.stack([shape[:3], shape[3:6]]) - origin
    x, y, z = basis @ ends.T
    if z.min() < 0.1:
        return np.zeros((0, 3))
    reach = 1.5 * camera[12] * float(shape[6:].max()) / float(z.min())
    columns = camera[13] + camera[12] * x / z
    rows = camera[14] - camera[12] * y / z
    across = np.arange(math.floor(columns.min() - reach), math.ceil(columns.max() + reach)) + 0.5
    down = np.arange(math.floor(rows.min() - reach), math.ceil(rows.max() + reach)) + 0.5
    across, down = across[(across > 0) & (across < SIZE[0])], down[(down > 0) & (down < SIZE[1])]
    u, v = np.meshgrid((across - camera[13]) / camera[12], -(down - camera[14]) / camera[12])
    rays = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def strike_shares(source: TakeSource, tracks: list[Track]) -> Iterator[list[tuple[float, float]]]:
    """Yield what each track shows of each strike of hands that lands on another avatar."""
    take = source.take
    events = take.events
    cast = build_cast(source.figures, source.avatar_figures, source.avatar_teams, source.avatar_scales,
                      None, source.avatar_girths, source.avatar_stretches)  # fmt: skip
    (body,) = source.figures
    assert isinstance(body, Body)
    gloves = np.flatnonzero(np.asarray(body.capsule_parts) == PARTS.index("glove"))
    (head,) = np.flatnonzero(np.asarray(body.capsule_parts) == PARTS.index("head"))
    (count,) = {np.count_nonzero(cast.owners == avatar) for avatar in range(take.avatar_count)}
    joint = body.roles["head"]
    sides = ["left_hand", "right_hand"]
    wanted = np.asarray(events.landed, bool) & (np.asarray(events.victim) >= 0) & (np.asarray(events.limb) < 2)
    for index in np.flatnonzero(wanted):
        frame = min(math.floor(float(events.frame[index]) / take.control_rate * FPS + 0.5), source.frame_count - 1)
        attacker, victim = int(events.attacker[index]), int(events.victim[index])
        poses = source.poses(frame)
        shapes = cast.place(poses).shapes.astype(float)
        hand = body.roles[sides[int(events.limb[index])]]
        (limb,) = gloves[np.asarray(body.capsule_joints)[gloves] == hand]
        first = victim * count
        worn = first + np.array([head, *range(len(body.capsule_parts), count)])
        of_head = worn[np.linalg.norm(shapes[worn, :3] - shapes[first + head, :3], axis=1) < 0.3]
        ahead = quaternion.rotate(poses[0][1][victim, joint], face_direction(body))
        yield [
            seen_shares(track.view(frame), shapes, attacker * count + int(limb), first + int(head), of_head, ahead)
            for track in tracks
        ]


def calmness(track: Track, source: TakeSource) -> dict[str, float]:
    """Return how often a camera cuts, and how fast it turns."""
    headings = [math.atan2(*track.view(frame).ahead[[0, 2]]) for frame in range(source.frame_count)]
    turns = np.abs(np.mod(np.diff(headings) + np.pi, 2 * np.pi) - np.pi)
    cuts = turns > CUT
    slow = np.degrees(turns[~cuts]) * FPS
    minutes = source.frame_count / FPS / 60.0
    return {
        "cuts_per_minute": float(cuts.sum() / minutes),
        "turn_median": float(np.median(slow)),
        "turn_99": float(np.percentile(slow, 99)),
    }


def measure(quick: bool) -> dict[str, Any]:
    """Return the figures of each scene."""
    outcome: dict[str, Any] = {}
    for scene in SCENES:
        shares: list[list[tuple[float, float]]] = []
        calm: list[dict[str, float]] = []
        seed = 0
        while len(shares) < (5 if quick else 1.5 * STRIKES) and seed < (2 if quick else 40):
            seed += 1
            done = run(load_scenario(scene, seed=seed, frames=150 if quick else None), threads=2)
            source = TakeSource(done, done.policies, FPS, threads=2)
            tracks = [build_track(source, camera, SIZE) for camera in CAMERAS]
            shares += strike_shares(source, tracks)
            calm.append(calmness(tracks[0], source))
        drawn = np.random.default_rng(1).permutation(len(shares))[:STRIKES]
        found = np.array(shares).reshape(-1, len(CAMERAS), 2)[drawn]
        outcome[scene] = {
            "strikes": len(found),
            "seeds": seed,
            **{
                camera: {
                    "seen_share": float((found[:, i].min(axis=1) >= HALF).mean()) if len(found) else None,
                    "glove_share": float((found[:, i, 0] >= HALF).mean()) if len(found) else None,
                    "face_share": float((found[:, i, 1] >= HALF).mean()) if len(found) else None,
                }
                for i, camera in enumerate(CAMERAS)
            },
            **{key: float(np.mean([one[key] for one in calm])) for key in calm[0]},
        }
    return outcome


def lines(outcome: Mapping[str, Any]) -> Iterator[str]:
    """Yield the table, a line each."""
    yield f"{'':<16}{'strikes':>9}{'seen':>9}{'glove':>9}{'face':>9}"
    for scene, found in outcome.items():
        for camera in CAMERAS:
            shares = (found[camera][key] for key in ("seen_share", "glove_share", "face_share"))
            text = "".join(f"{'':>9}" if share is None else f"{share:9.1%}" for share in shares)
            yield f"{scene + ', ' + camera:<16}{found['strikes']:9}{text}"
        yield (
            f"{scene}: {found['cuts_per_minute']:.1f} cuts per minute, {found['turn_median']:.1f} degrees per second "
            f"at the median, {found['turn_99']:.1f} in one of a hundred frames"
        )


def main() -> None:
    parser = command_line("How much do cameras show of strikes that land?", "seconds: a few strikes, small policies")
    options = parser.parse_args()
    with small_policies(falls=True, wanted=options.quick):
        outcome = measure(options.quick)
    print(json.dumps(outcome, indent=2) if options.json else "\n".join(lines(outcome)))


if __name__ == "__main__":
    main()
