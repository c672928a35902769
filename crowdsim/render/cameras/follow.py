"""Follows one avatar from behind its shoulder, and goes around what stands in the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from crowdsim.core.types import Array
from crowdsim.render.crowd_path import between, hann
from crowdsim.render.view import View, look_at
from crowdsim.render.viewpoints import HEADINGS, find_course
from crowdsim.scenario.camera import AvatarRef, Camera, avatar_number

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage

_ASIDE = 0.30
"""How far aside of straight behind it looks from [rad]."""
_TURN, _BLOCKED, _TRUNK, _CLEAR = 0.8, 1.0, 0.22, 1.0
"""Costs of looking from elsewhere [1/rad^2] and of a body in the way, that body's radius, and how far from bodies the
camera stays [m]."""
_POSITION, _HEADING = 0.8, 1.6
"""Times to either side over which the avatar's position and heading are smoothed [s]."""


class FollowCamera(Camera):
    """Follows an avatar from behind its shoulder."""

    follows = "avatar"

    kind: Literal["follow"] = Field(description="Follows an avatar from behind its shoulder.")
    avatar: AvatarRef = Field(default=0, description="Number or name of the avatar.")
    distance: float | None = Field(
        default=None, ge=0.3, le=1000, description="Level distance to the avatar [m]; 2.5 times its height without it."
    )
    height: float | None = Field(
        default=None,
        ge=0.05,
        le=1000,
        description="Height of the camera [m]; 1.55 times that of the avatar without it.",
    )
    lead_room: float = Field(
        default=0.7,
        ge=0,
        le=5,
        description="How far ahead of the avatar the middle of the picture lies, in heights of the avatar.",
    )
    avoid: bool = Field(default=True, description="Whether it goes around others that stand in the way.")

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        source, field = footage.source, self.field
        number = avatar_number(self.avatar, source.avatar_names)
        path, step = footage.ground_path(number)
        tall = float(source.avatar_heights[number])
        places = hann(path[:, :2], max(1, round(_POSITION * source.fps / step)))
        headings = hann(path[:, 2:], max(1, round(_HEADING * source.fps / step)))[:, 0]
        distance, height = self.distance or 2.5 * tall, self.height or 1.55 * tall
        lead = self.lead_room * tall
        turns = headings - _ASIDE
        if self.avoid and footage.crowd.avatars > 1:
            turns = _detours(footage, number, places, turns, step, distance, height)

        def view(frame: float) -> View:
            x, z = between(places, frame / step)
            heading, turn = float(between(headings, frame / step)), float(between(turns, frame / step))
            eye = np.array([x - distance * math.sin(turn), height, z - distance * math.cos(turn)])
            target = np.array([x + lead * math.sin(heading), 0.5 * tall, z + lead * math.cos(heading)])
            return look_at(eye, target, field)

        return view

    def avatars_named(self) -> Iterator[tuple[tuple[str | int, ...], int | str]]:
        """Yield the key of each avatar that the camera names, and its number or name."""
        yield ("avatar",), self.avatar


def _detours(
    footage: Footage, number: int, places: Array, turns: Array, step: int, distance: float, height: float
) -> Array:
    """Return the headings in which a camera looks at an avatar past others, near ``turns`` (M,) [rad]."""
    from crowdsim.render.line_of_sight import are_in_sight

    crowd = footage.crowd
    around = np.arange(HEADINGS) * (2.0 * math.pi / HEADINGS)
    costs = np.empty((len(crowd.grounds), HEADINGS, 1))
    for moment, ground in enumerate(crowd.grounds[:, : crowd.avatars]):
        at = moment * crowd.step / step
        place, wanted = between(places, at), float(between(turns, at))
        near = np.flatnonzero(np.linalg.norm(ground[:, :2] - place, axis=1) < distance + 1.0)
        near = near[near != number]
        x, z = ground[near, :2].T.astype(float)
        tall, thick = crowd.heights[near], np.full(len(near), _TRUNK)
        shapes = np.stack([x, 0.1 * tall, z, x, 0.85 * tall, z, thick, thick], axis=1)
        eyes = np.stack(
            [place[0] - distance * np.sin(around), np.full(HEADINGS, height), place[1] - distance * np.cos(around)],
            axis=1,
        )
        body = np.array([[place[0], share * crowd.heights[number], place[1]] for share in (0.4, 0.65, 0.9)])
        off = (around - wanted + math.pi) % (2.0 * math.pi) - math.pi
        gaps = np.linalg.norm(eyes[:, None, [0, 2]] - ground[near, :2], axis=-1).min(axis=1, initial=_CLEAR)
        hidden = 1.0 - are_in_sight(body, eyes, shapes).mean(axis=1)
        costs[moment, :, 0] = _TURN * off**2 + _BLOCKED * (hidden + 1.0 - gaps / _CLEAR)
    course = find_course(costs, np.zeros(1), np.full(len(costs), np.inf), max(1, round(0.75 * crowd.fps / crowd.step)))
    found = course.angles[0][:, 0]
    return np.array([float(between(found, frame * step / crowd.step)) for frame in range(len(turns))])


CAMERA = FollowCamera
