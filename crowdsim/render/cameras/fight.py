"""A three-quarter view of a pair or a group, from where the least is hidden of strikes that land."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from crowdsim.core.types import Array
from crowdsim.render.crowd_path import between, envelope, filled, smooth
from crowdsim.render.framing import CloseFrame
from crowdsim.render.view import View
from crowdsim.render.viewpoints import HEADINGS, find_course
from crowdsim.scenario.camera import AvatarRef, Camera, avatar_number

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage
    from crowdsim.render.line_of_sight import Strike

_GROUP = 4
"""Up to how many avatars all are shown."""
_ELEVATIONS = np.radians([4.0, 15.0, 27.0, 38.0])
_HEADINGS = np.arange(HEADINGS) * (2.0 * math.pi / HEADINGS)
_BEST, _SPREAD = math.radians(58.0), math.radians(32.0)
"""Angle between the view and the line between opponents that looks best, and how far off it may be."""
_OBLIQUE, _HIGH, _AGAINST_LIGHT, _BLOCKED, _HIDDEN = 0.12, 0.04, 0.15, 0.5, 10.0
"""Costs at a moment: of another angle than the best, of looking down by ten degrees, of looking against the light, of a
body in the way; and of a hidden strike."""
_LITTLE, _ENOUGH = 0.35, 0.65
"""Shares of a limb and of a face that are as good as hidden, and as good as seen."""
_CUT, _MID_ACTION = 2.0, 30.0
"""Costs of a cut at a lull, and during an exchange."""
_LULL = (0.4, 0.3)
"""A lull is so long before the next strike and after the last one [s]."""
_SMOOTH = 0.4
"""Time to either side over which movement is smoothed [s]."""
_WINDOW = 1.5
"""Time to either side for which a picture has room for what it shows [s]."""
_MOST_STRIKES = 4000
_CLOSE = 1.0
"""How far from an avatar that is shown a strike may be that concerns it [m]."""
_TRUNK, _CLEAR = 0.2, 1.3
"""Radius of what stands for a body in the way, and how far from bodies the camera stays [m]."""


class FightCamera(Camera):
    """A three-quarter view of a pair or a group, from where the least is hidden."""

    follows = "avatars"

    kind: Literal["fight"] = Field(
        description="A three-quarter view of a pair or a group, from where the least is hidden; it moves, and cuts at "
        "lulls."
    )
    avatars: tuple[AvatarRef, ...] = Field(
        default=(),
        max_length=100,
        description="Numbers or names of those that it shows; a single avatar is shown with the nearest other one. "
        "Without them all of up to four avatars, else the one with the most strikes.",
    )
    cuts: bool = Field(default=True, description="Whether it may cut; else it only moves.")
    elevation: float | None = Field(
        default=None, ge=0, le=80, description="How far down it looks [degrees]; what shows most without it."
    )
    distance: float | None = Field(
        default=None, gt=0, le=1000, description="Level distance to the middle [m]; as near as shows all without it."
    )

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        from crowdsim.crowd.kernels.layout import BLOCKED, LANDED
        from crowdsim.render.line_of_sight import StrikeFinder, strikes_of

        crowd, source = footage.crowd, footage.source
        frames, points, outcomes = strikes_of(source, (LANDED, BLOCKED))
        shown = self._shown(footage, frames, points)
        subjects = np.take_along_axis(crowd.grounds, shown[:, :, None], axis=1).astype(float)
        heights = crowd.heights[shown]
        frame = CloseFrame(footage.size, self.field, float(heights.max()), self.distance)
        flat = filled(subjects[..., :2])
        centres = smooth(0.5 * (flat.min(axis=1) + flat.max(axis=1)), crowd)
        elevations = _ELEVATIONS if self.elevation is None else np.radians([self.elevation])
        angles = np.stack(np.broadcast_arrays(_HEADINGS[:, None], elevations), axis=-1).reshape(-1, 2)
        window = round(_WINDOW * crowd.fps / crowd.step)

        def eyes(at: float) -> Array:
            """Candidates of eyes at a moment. Shape (H E, 3)."""
            part = slice(max(round(at) - window, 0), round(at) + window + 1)
            limits = frame.limits(subjects[part, None], heights[part, None], centres[part, None], angles)
            return frame.eyes(between(centres, at), angles, limits.max(axis=0))

        costs = _axis_costs(footage, flat)[:, :, None] + _HIGH * np.degrees(elevations) / 10.0
        costs += _AGAINST_LIGHT * (0.5 - 0.5 * np.cos(_HEADINGS - crowd.facing))[:, None]
        for moment in range(len(costs)):
            costs[moment] += _blocked_costs(footage, moment, shown[moment], eyes(moment)).reshape(costs.shape[1:])
        finder, cuts = StrikeFinder(source), np.full(len(costs), float(_CUT if self.cuts else np.inf))
        times, looked_at = np.arange(len(costs)) * crowd.step / crowd.fps, 0
        for number, point, outcome in zip(frames, points, outcomes, strict=True):
            at = min(number / crowd.step, len(costs) - 1.0)
            gaps = np.linalg.norm(subjects[round(at), :, :2] - point[[0, 2]], axis=1)
            if np.nan_to_num(gaps, nan=np.inf).min() > _CLOSE:
                continue
            seconds = times - number / crowd.fps
            cuts[(seconds > -_LULL[0]) & (seconds < _LULL[1])] += _MID_ACTION
            looked_at += outcome == LANDED
            strike = finder.find(int(number), point) if outcome == LANDED and looked_at <= _MOST_STRIKES else None
            if strike is not None:
                hidden = _hidden_costs(strike, eyes(at)).reshape(costs.shape[1:])
                low = math.floor(at)
                for moment, share in ((low, 1.0 - at + low), (min(low + 1, len(costs) - 1), at - low)):
                    costs[moment] += share * hidden
        course = find_course(costs, elevations, cuts, max(1, round(_SMOOTH * crowd.fps / crowd.step)))
        limits = []
        for start, own in zip(course.starts, course.angles, strict=True):
            part = slice(int(start), int(start) + len(own))
            limits.append(envelope(frame.limits(subjects[part], heights[part], centres[part], own), crowd, _WINDOW))
        step = crowd.step

        def view(number: float) -> View:
            at = number / step
            return frame.view(between(centres, at), course.at(at), course.at(at, limits))

        return view

    def _shown(self, footage: Footage, frames: Array, points: Array) -> Array:
        """Return the numbers of those that are shown at each moment. Shape (M, n)."""
        crowd = footage.crowd
        numbers = [avatar_number(avatar, footage.source.avatar_names) for avatar in self.avatars]
        if not numbers and 1 <= len(crowd.present) <= _GROUP:
            numbers = [*crowd.present, *range(crowd.avatars, crowd.grounds.shape[1])]
        moments = np.minimum(np.round(frames / crowd.step).astype(int), len(crowd.grounds) - 1)
        flat = crowd.grounds[:, : crowd.avatars, :2]
        if not numbers:
            counts = np.zeros(crowd.avatars)
            for moment, point in zip(moments, points, strict=True):
                gaps = np.linalg.norm(flat[moment] - point[[0, 2]], axis=1)
                counts[np.argsort(gaps)[:2]] += 1.0
            numbers = [int(counts.argmax())]
        if len(numbers) > 1 or crowd.avatars == 1:
            return np.tile(numbers, (len(crowd.grounds), 1))
        gaps = np.linalg.norm(flat - flat[:, numbers], axis=-1)
        gaps[:, numbers] = np.inf
        return np.stack([np.full(len(flat), numbers[0]), np.nan_to_num(gaps, nan=np.inf).argmin(axis=1)], axis=1)

    def avatars_named(self) -> Iterator[tuple[tuple[str | int, ...], int | str]]:
        """Yield the key of each avatar that the camera names, and its number or name."""
        for i, avatar in enumerate(self.avatars):
            yield ("avatars", i), avatar


def _axis_costs(footage: Footage, places: Array) -> Array:
    """Return what each heading costs at each moment for its angle to the line between opponents. Shape (M, H)."""
    flat = places - places.mean(axis=1, keepdims=True)
    xx, zz = (flat[..., 0] ** 2).mean(axis=1), (flat[..., 1] ** 2).mean(axis=1)
    xz = (flat[..., 0] * flat[..., 1]).mean(axis=1)
    # Of twice the heading of the line: it has no direction.
    pairs = smooth(np.stack([zz - xx, 2.0 * xz], axis=1), footage.crowd)
    line = 0.5 * np.arctan2(pairs[:, 1], pairs[:, 0])
    clear = np.hypot(*pairs.T) / np.maximum(smooth((xx + zz)[:, None], footage.crowd)[:, 0], 1e-9)
    off = np.abs((_HEADINGS - line[:, None] + 0.5 * math.pi) % math.pi - 0.5 * math.pi)
    return np.asarray(_OBLIQUE * clear[:, None] * ((off - _BEST) / _SPREAD) ** 2)


def _blocked_costs(footage: Footage, moment: int, shown: Array, eyes: Array) -> Array:
    """Return what each eye (E, 3) costs for bodies between it and those that are shown at a moment. Shape (E,)."""
    from crowdsim.render.line_of_sight import are_in_sight

    crowd = footage.crowd
    ground = crowd.grounds[moment, : crowd.avatars]
    here = np.isfinite(ground[:, 0])
    shown = shown[shown < crowd.avatars]
    shown = shown[here[shown]]
    if not len(shown):
        return np.zeros(len(eyes))
    reach = np.linalg.norm(eyes[:, [0, 2]] - ground[shown[0], :2], axis=1).max()
    bodies = np.flatnonzero(here & (np.linalg.norm(ground[:, :2] - ground[shown[0], :2], axis=1) < reach))
    x, z = ground[bodies, :2].T.astype(float)
    tall = crowd.heights[bodies]
    thick = np.full(len(bodies), _TRUNK)
    shapes = np.stack([x, 0.15 * tall, z, x, 0.85 * tall, z, thick, thick], axis=1)
    hidden = np.zeros(len(eyes))
    for avatar in shown:
        place = np.array(
            [[ground[avatar, 0], share * crowd.heights[avatar], ground[avatar, 1]] for share in (0.7, 0.92)]
        )
        hidden += 1.0 - are_in_sight(place, eyes, shapes[bodies != avatar]).mean(axis=1)
    gaps = np.linalg.norm(eyes[:, None, [0, 2]] - np.stack([x, z], axis=1), axis=-1).min(axis=1)
    near = np.clip(1.0 - gaps / _CLEAR, 0.0, 1.0) * (eyes[:, 1] < 1.2 * tall.max())
    return np.asarray(_BLOCKED * (hidden / len(shown) + 2.0 * near))


def _hidden_costs(strike: Strike, eyes: Array) -> Array:
    """Return what each eye (E, 3) costs for how little it sees of a strike. Shape (E,)."""
    limb, face = strike.limb_shown(eyes), strike.face_shown(eyes)
    share = np.clip((np.minimum(limb, face) - _LITTLE) / (_ENOUGH - _LITTLE), 0.0, 1.0)
    return np.asarray(_HIDDEN * (1.0 - share * share * (3.0 - 2.0 * share)))


CAMERA = FightCamera
