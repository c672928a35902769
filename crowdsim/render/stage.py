"""One picture of a source: its cast, its cameras, its flashes and its caption, ready to draw any frame."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.render.camera import Keys, Track, build_track, parse_camera
from crowdsim.render.caption import draw_caption
from crowdsim.render.crowd_path import watch
from crowdsim.render.raycast import Flashes, draw
from crowdsim.render.scene import Cast, build_cast
from crowdsim.render.source import PoseSource, Shown

VERSION = 4
"""Counts changes after which pictures differ."""
_BETWEEN = 34
"""Grey of the line between cameras side by side."""
FLASH = 0.28
"""Time for which the mark of a strike shows [s]."""


@dataclass(frozen=True)
class Stage:
    """A source with everything that its pictures share; any number of threads may draw from it.

    Attributes:
        source: Where motion comes from.
        cast: Its avatars as figures.
        tracks: Cameras, side by side from left to right.
        size: Width and height [px].
        caption: Whether the picture has a caption.
        mark: A text that differs whenever a picture would.
    """

    source: PoseSource
    cast: Cast
    tracks: tuple[Track, ...]
    size: tuple[int, int]
    caption: bool
    mark: str

    def picture(self, frame: int, threads: int = 1, stop: int | None = None) -> Array:
        """Draw a frame.

        Args:
            frame: The frame.
            threads: Threads that share the picture.
            stop: One past the last frame that is drawn after it; that of the next one when None.

        Returns:
            Shape (height, width, 3), uint8.
        """
        points, ages, speeds, outcomes = self.source.recent_strikes(frame)
        shown = Shown(stop or frame + 1, self.scales)
        capsules = self.cast.place(self.source.poses(frame, shown), self.source.markers(frame))
        young = np.asarray(ages) < FLASH
        flashes = Flashes(
            np.asarray(points)[young],
            np.asarray(ages)[young] / FLASH,
            0.55 + 0.45 * np.clip(np.asarray(speeds)[young] / 9.0, 0.0, 1.0),
            np.asarray(outcomes)[young],
        )
        height, edges = self.size[1], self._edges()
        parts = [
            draw(capsules, track.view(frame), (right - left, height), track.sun, flashes, threads, self.source.arena)
            for track, left, right in zip(self.tracks, edges[:-1], edges[1:], strict=True)
        ]
        picture = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
        for edge in edges[1:-1]:
            picture[:, max(edge - 1, 0) : edge + 1] = _BETWEEN
        if self.caption:
            draw_caption(picture, self.title(frame))
        return picture

    def scales(self, frame: int) -> Array:
        """Return at how many pixels a metre each avatar shows at a frame, 0 where nothing of it is seen. Shape (N,)."""
        ground, edges = self.source.ground(np.array([frame]))[0], self._edges()
        there = np.isfinite(ground).all(axis=1)
        ground = np.where(there[:, None], ground, 0.0)
        seen = [
            track.view(frame).scales(ground, (right - left, self.size[1]))
            for track, left, right in zip(self.tracks, edges[:-1], edges[1:], strict=True)
        ]
        return np.where(there, np.max(seen, axis=0), 0.0)

    def _edges(self) -> list[int]:
        """Left edge of each camera's part, and the right edge of the last [px]."""
        return [round(self.size[0] * i / len(self.tracks)) for i in range(len(self.tracks) + 1)]

    def title(self, frame: int) -> str:
        """Return the caption of a frame: name, avatars, time."""
        count = len(self.source.avatar_teams)
        crowd = f"   {count:,} avatars" if count > 1 else ""
        return f"{self.source.name}{crowd}   {frame / self.source.fps:.2f} s   squares 1 m"


def build_stage(source: PoseSource, size: tuple[int, int], camera: str | Keys = "auto", caption: bool = True) -> Stage:
    """Prepare pictures of a source.

    Args:
        source: Where motion comes from.
        size: Width and height [px].
        camera: Name of a camera, several joined by '+' for pictures side by side, or keys.
        caption: Whether the picture has a caption.

    Raises:
        CrowdsimError: There is no such camera or avatar.
    """
    if isinstance(camera, Keys):
        kinds: list[str | Keys] = [camera]
        named = [camera.seconds.tolist(), camera.positions.tolist(), camera.targets.tolist()]
    else:
        camera = parse_camera(camera, len(source.avatar_teams), tuple(source.avatar_names))
        kinds = [*camera.split("+")]
        named = [camera]
    crowd = watch(source)
    part = (max(1, size[0] // len(kinds)), size[1])
    arena = np.asarray(source.arena, float).tolist()
    content = [VERSION, source.fingerprint, source.name, source.fps, source.frame_count, list(size), named, caption]
    content.append(arena)
    return Stage(
        source=source,
        cast=build_cast(
            source.figures,
            source.avatar_figures,
            source.avatar_teams,
            source.avatar_scales,
            source.avatar_colours,
            source.avatar_girths,
            source.avatar_stretches,
        ),
        tracks=tuple(build_track(source, kind, part, crowd) for kind in kinds),
        size=size,
        caption=caption,
        mark=hashlib.sha256(json.dumps(content).encode()).hexdigest()[:32],
    )
