"""Draws what holds poses together: strips through transitions, planted feet and landed strikes, before and after.

    python docs/quality_strips.py RUN [PICTURE] [--seed N]

Five transitions over which the body changes most, five over which a planted foot would jump furthest, and five strikes
that land, drawn among the hundred that ask for most. Each is shown from the side, by moments that are evenly spaced
(times in seconds from the transition or the strike): above as captured, without a blend, below as it is shown.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from crowdsim.core.types import Array
from crowdsim.poses.sampler import Poses, PoseSampler
from crowdsim.render.caption import draw_caption
from crowdsim.render.raycast import draw, sun_direction
from crowdsim.render.scene import build_cast
from crowdsim.render.view import look_at
from crowdsim.runs.opening import open_run

FPS = 60.0
STEPS, WIDE_STEPS = np.arange(-12, 13, 3), np.arange(-28, 29, 7)
"""Frames around a moment that are shown, and around one that has feet step."""
TILE = (170, 190)
_MOST_AVATARS = 60


def draw_strips(sampler: PoseSampler, path: Path, seed: int = 1, threads: int = 2) -> None:
    """Draw all strips into a PNG file."""
    rng = np.random.default_rng(seed)
    rows = []
    for title, moments, steps in (
        ("transition", transitions(sampler, rng), STEPS),
        ("planted foot", plants(sampler, rng), WIDE_STEPS),
        ("strike", strikes(sampler, rng), STEPS),
    ):
        for number, (time, avatars) in enumerate(moments):
            rows.append(draw_moment(sampler, f"{title} {number + 1}", time, avatars, steps, threads))
    picture = Image.fromarray(np.concatenate(rows)).quantize(220, dither=Image.Dither.NONE)
    temporary = path.with_name(f".{path.name}")
    picture.save(temporary, format="PNG", optimize=True)
    temporary.replace(path)


def draw_moment(
    sampler: PoseSampler, title: str, time: float, avatars: list[int], steps: Array, threads: int = 2
) -> Array:
    """Draw two rows of tiles around a time, from the side of the first avatar."""
    middle = round(time * FPS)
    start, stop = middle + int(steps[0]), middle + int(steps[-1]) + 1
    who = np.array(sorted(avatars))
    before, after = sampler.captured(start, stop, FPS, who), sampler.sample(start, stop, FPS, who)
    result = next(poses for poses in after if avatars[0] in poses.avatars)
    ground = result.ground[len(result.ground) // 2, int(np.flatnonzero(result.avatars == avatars[0])[0])]
    centre = np.array([ground[0], 0.8, ground[1]])
    if len(avatars) > 1:
        other = next(poses for poses in after if avatars[1] in poses.avatars)
        there = other.ground[len(other.ground) // 2, int(np.flatnonzero(other.avatars == avatars[1])[0])]
        way = there[:2] - ground[:2]
        azimuth = math.atan2(way[0], way[1]) + 0.5 * math.pi
        centre[[0, 2]] += 0.5 * way
    else:
        azimuth = float(ground[2]) + 0.5 * math.pi
    eye = centre + 5.6 * np.array([math.sin(azimuth), 0.1, math.cos(azimuth)])
    strips = [
        np.concatenate(
            [_draw_tile(sampler, poses, steps, at, eye, centre, azimuth, threads) for at in range(len(steps))], 1
        )
        for poses in (before, after)
    ]
    draw_caption(strips[0], f"{title}, as captured", corner=(5, 3), height=14)
    draw_caption(strips[1], "as shown", corner=(5, 3), height=14)
    gap = np.full((6, strips[0].shape[1], 3), 245, np.uint8)
    return np.concatenate([*strips, gap])


def _draw_tile(
    sampler: PoseSampler,
    poses: list[Poses],
    steps: Array,
    step: int,
    eye: Array,
    centre: Array,
    azimuth: float,
    threads: int,
) -> Array:
    at = int(steps[step] - steps[0])
    figures, owners, scales, posed = [], [], [], []
    for index, part in enumerate(poses):
        figures.append(sampler.policies[part.policy].database.body)
        owners.extend([index] * len(part.avatars))
        scales.extend(part.scales.tolist())
        positions, turns = part.at(at).joints()
        posed.append((positions[0], turns[0]))
    colours = np.array([[0.62, 0.3, 0.22], [0.25, 0.36, 0.6]])[: len(owners)]
    cast = build_cast(figures, np.array(owners, np.int32), scales, colours=colours)
    large = draw(
        cast.place(posed),
        look_at(eye, centre, field=math.radians(24.0)),
        (2 * TILE[0], 2 * TILE[1]),
        sun_direction(azimuth + 0.7),
        threads=threads,
    ).astype(np.uint16)
    small = (large[::2, ::2] + large[1::2, ::2] + large[::2, 1::2] + large[1::2, 1::2] + 2) // 4
    tile = small.astype(np.uint8)
    draw_caption(tile, f"{steps[step] / FPS:+.2f}", corner=(5, TILE[1] - 16), height=11)
    return tile


def _some_transitions(sampler: PoseSampler) -> list[tuple[Any, Any, Array]]:
    take = sampler.take
    result = []
    for index in range(len(sampler.motions)):
        avatars = np.flatnonzero(take.cast.policies == index)[:_MOST_AVATARS]
        if len(avatars):
            window = sampler.window(index, avatars, np.array([0.0, take.seconds]))
            result.append((sampler.motions[index].frames, window.transitions, avatars))
    return result


def _pick(sizes: Array, moments: list[tuple[float, list[int]]], rng: np.random.Generator) -> list[Any]:
    """Five among the hundred largest, in order of time."""
    largest = np.argsort(-sizes, kind="stable")[:100]
    chosen = rng.permutation(largest)[:5]
    return sorted((moments[int(k)] for k in chosen), key=lambda moment: moment[0])


def _inside(sampler: PoseSampler, time: float) -> bool:
    return 0.5 < time < sampler.take.seconds - 0.5


def transitions(sampler: PoseSampler, rng: np.random.Generator) -> list[tuple[float, list[int]]]:
    """Return times and avatars of five transitions over which the body changes much."""
    sizes, moments = [], []
    for frames, transitions, avatars in _some_transitions(sampler):
        turned = np.abs(np.sum(frames.rotations[transitions.before] * frames.rotations[transitions.after], axis=-1))
        change = np.arccos(np.clip(turned, 0.0, 1.0)).mean(axis=1)
        for k in range(len(transitions.times)):
            sizes.append(change[k] if _inside(sampler, transitions.times[k]) else -1.0)
            moments.append((float(transitions.times[k]), [int(avatars[transitions.owners[k]])]))
    return _pick(np.array(sizes), moments, rng)


def plants(sampler: PoseSampler, rng: np.random.Generator) -> list[tuple[float, list[int]]]:
    """Return times and avatars of five transitions over which planted feet would jump far."""
    sizes, moments = [], []
    for frames, transitions, avatars in _some_transitions(sampler):
        planted = frames.contacts[transitions.before] & frames.contacts[transitions.after]
        jump = (np.linalg.norm(transitions.gaps[..., :3], axis=-1) * planted).max(axis=1)
        for k in range(len(transitions.times)):
            sizes.append(jump[k] if _inside(sampler, transitions.times[k]) else -1.0)
            moments.append((float(transitions.times[k]), [int(avatars[transitions.owners[k]])]))
    return _pick(np.array(sizes), moments, rng)


def strikes(sampler: PoseSampler, rng: np.random.Generator) -> list[tuple[float, list[int]]]:
    """Return times, attackers and victims of five fast strikes that land."""
    events, rate = sampler.take.events, sampler.take.control_rate
    sizes, moments = [], []
    for k in np.flatnonzero(np.asarray(events.landed) & (np.asarray(events.victim) >= 0)):
        time = float(events.frame[k]) / rate
        sizes.append(float(events.speed[k]) if _inside(sampler, time) else -1.0)
        moments.append((time, [int(events.attacker[k]), int(events.victim[k])]))
    return _pick(np.array(sizes), moments, rng)


def main() -> None:
    """Read the command line and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of a run")
    parser.add_argument("picture", type=Path, nargs="?", default=Path(__file__).parent / "quality_strips.png")
    parser.add_argument("--seed", type=int, default=1, help="which five are drawn")
    options = parser.parse_args()
    take, policies, _ = open_run(options.run)
    draw_strips(PoseSampler(take, policies, threads=2), options.picture, options.seed)


if __name__ == "__main__":
    main()
