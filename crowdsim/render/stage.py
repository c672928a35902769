"""One picture of a source: its cast, its cameras, its flashes and its caption, ready to draw any frame."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.layout import LANDED
from crowdsim.errors import CrowdsimError, TakeError
from crowdsim.render.camera import Track, build_track, resolve_camera
from crowdsim.render.caption import draw_caption
from crowdsim.render.crowd_path import watch
from crowdsim.render.edit import EditedSource
from crowdsim.render.look import Look
from crowdsim.render.obstacles import add_obstacles, hide_avatars
from crowdsim.render.raycast import Capsules, Flashes, PosedSkins, draw
from crowdsim.render.scene import Cast, build_cast
from crowdsim.render.skins import BODY_SCALE, LEAST_SCALE, SkinCast
from crowdsim.render.source import PoseSource, Shown
from crowdsim.render.view import View
from crowdsim.scenario.cameras import Chosen

VERSION = 13
"""Counts changes after which pictures differ."""
_BETWEEN = 34
"""Grey of the line between cameras side by side."""
FLASH = 0.28
"""Time for which the mark of a strike shows [s]."""


@dataclass(frozen=True)
class Stage:
    """A source with everything that its pictures share; any number of threads may draw from it.

    Attributes:
        source: Where motion comes from; of shots, the frames of the edited video.
        cast: Its avatars as figures.
        skins: Their skins; None where there are none, or where the look shows capsules alone.
        tracks: Cameras, side by side from left to right.
        size: Width and height [px].
        look: Light, background, marks and caption.
        mark: A text that differs whenever a picture would.
        finer: Draws the moments that pictures with motion blur are the mean of; None for sharp ones.
    """

    source: PoseSource
    cast: Cast
    skins: SkinCast | None
    tracks: tuple[Track, ...]
    size: tuple[int, int]
    look: Look
    mark: str
    finer: Stage | None = None

    def resized(self, size: tuple[int, int], look: Look) -> Stage:
        """Return it with pictures of another size and look."""
        finer = None if self.finer is None else self.finer.resized(size, look)
        return replace(self, size=size, look=look, finer=finer)

    def picture(self, frame: int, threads: int = 1, stop: int | None = None) -> Array:
        """Draw a frame.

        Args:
            frame: The frame.
            threads: Threads that share the picture.
            stop: One past the last frame that is drawn after it; that of the next one when None.

        Returns:
            Shape (height, width, 3), uint8; with a fourth channel, how figures cover, where the look is transparent.
        """
        picture = self._blurred(frame, threads, stop) if self.finer else self._still(frame, threads, stop)
        if self.look.caption and not self.look.transparent:
            draw_caption(picture, self.title(frame))
        return picture

    def _blurred(self, frame: int, threads: int, stop: int | None) -> Array:
        """Draw the mean of what an open shutter sees for half a frame, in linear light."""
        assert self.finer is not None
        samples = self.look.motion_blur
        first, last = 2 * samples * frame, self.finer.source.frame_count - 1
        end = first + samples  # while the shutter is closed nothing is posed
        return mean_light([self.finer._still(min(first + sample, last), threads, end) for sample in range(samples)])

    def _still(self, frame: int, threads: int, stop: int | None) -> Array:
        """Draw a frame without motion blur and caption."""
        points, ages, speeds, outcomes = self.source.recent_strikes(frame)
        shown = Shown(stop or frame + 1, self.scales)
        poses = self.source.poses(frame, shown)
        capsules = self.cast.place(poses, self.source.markers(frame))
        held = getattr(self.source, "held", None)
        if held is not None:
            capsules = capsules.joined(held(poses))
        skins = None
        if self.skins is not None:
            least = BODY_SCALE if self.look.figure == "auto" else LEAST_SCALE
            skins = self.skins.pose(poses, self.scales(frame), least)
        marked = np.asarray(ages) < FLASH
        if self.look.marks != "all":
            marked &= (np.asarray(outcomes) == LANDED) & (self.look.marks == "landed")
        flashes = Flashes(
            np.asarray(points)[marked],
            np.asarray(ages)[marked] / FLASH,
            0.55 + 0.45 * np.clip(np.asarray(speeds)[marked] / 9.0, 0.0, 1.0),
            np.asarray(outcomes)[marked],
        )
        height, edges = self.size[1], self._edges()
        parts = [
            mean_light(
                [
                    draw(
                        shown[0],
                        view,
                        (right - left, height),
                        track.sun,
                        flashes,
                        threads,
                        self.source.arena,
                        self.look,
                        shown[1],
                    )
                    for view in track.view(frame).through_lens(height)
                ]
            )
            for track, left, right in zip(self.tracks, edges[:-1], edges[1:], strict=True)
            for shown in [self._among_obstacles(capsules, skins, frame, track.view(frame))]
        ]
        picture = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
        for edge in edges[1:-1]:
            picture[:, max(edge - 1, 0) : edge + 1] = 0 if self.look.transparent else _BETWEEN
        return picture

    def _among_obstacles(
        self, capsules: Capsules, skins: PosedSkins | None, frame: int, view: View
    ) -> tuple[Capsules, PosedSkins | None]:
        """Return avatars among obstacles; of some cameras without obstacles that hide avatars."""
        obstacles = getattr(self.source, "obstacles", None)
        if obstacles is None or not len(obstacles):
            return capsules, skins
        if view.sees_through:
            ground = self.source.ground(np.array([frame]))[0, :, :2]
            obstacles = obstacles[~hide_avatars(obstacles, view.eye, ground)]
        return add_obstacles(capsules, skins, obstacles, self.source.seconds(frame))  # type: ignore[attr-defined]

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
        squares = "   squares 1 m" if self.look.grid and self.look.background in ("day", "dark") else ""
        return f"{self.source.name}{crowd}   {frame / self.source.fps:.2f} s{squares}"


def mean_light(pictures: Sequence[Array]) -> Array:
    """Return the mean of pictures in linear light; with a fourth channel, colours count as much as figures cover.

    Args:
        pictures: Each of shape (height, width, 3 or 4), uint8.
    """
    if len(pictures) == 1:
        return pictures[0]
    light: Any = 0.0
    cover: Any = 0.0
    transparent = pictures[0].shape[2] == 4
    for picture in pictures:
        part = picture.astype(np.float32)
        # A figure that covers half of a pixel gives it half as much light.
        own = part[..., 3:] if transparent else np.float32(255.0)
        light, cover = light + part[..., :3] ** 2 * own, cover + own
    mean = np.sqrt(light / np.maximum(cover, np.float32(1e-3)))
    if transparent:
        mean = np.concatenate([mean, np.asarray(cover) / len(pictures)], axis=2)
    return np.asarray((mean + 0.5).astype(np.uint8))


def build_stage(
    source: PoseSource,
    size: tuple[int, int],
    camera: Chosen = "auto",
    look: Look | None = None,
    shots: Sequence[Any] = (),
) -> Stage:
    """Prepare pictures of a source.

    Args:
        source: Where motion comes from.
        size: Width and height [px].
        camera: A camera, see ``resolve_camera``; of several pictures are drawn side by side.
        look: Light, background, marks and caption.
        shots: Shots (``scenario.cameras.Shot``) of an edited video, instead of the camera.

    Raises:
        CrowdsimError: There is no such camera or avatar.
        TakeError: A shot has frames that the source does not have.
    """
    look, crowd = look or Look(), watch(source)
    cameras = [resolve_camera(source, shot.camera) for shot in shots] or [resolve_camera(source, camera)]
    if shots and max(map(len, cameras)) > 1:
        raise CrowdsimError("a shot has several cameras, expected one")
    part = (max(1, size[0] // len(cameras[0])), size[1])
    tracks = {one: build_track(source, one, part, crowd) for one in dict.fromkeys(sum(cameras, ()))}
    arena = np.asarray(source.arena, float).tolist()
    content = [VERSION, source.fingerprint, source.name, source.fps, source.frame_count, list(size)]
    content += [[one.model_dump(mode="json") for one in sum(cameras, ())], asdict(look), arena]
    obstacles = getattr(source, "obstacles", None)
    if obstacles is not None and len(obstacles):
        content.append(obstacles.tobytes().hex())
    content.append([shot.model_dump(mode="json") for shot in shots])
    cast = build_cast(
        source.figures,
        source.avatar_figures,
        source.avatar_teams,
        source.avatar_scales,
        source.avatar_colours,
        source.avatar_girths,
        source.avatar_stretches,
        getattr(source, "avatar_bare", None),
    )
    mark = hashlib.sha256(json.dumps(content).encode()).hexdigest()[:32]

    skin = getattr(source, "skin", None)
    if look.figure == "body" and skin is None:
        raise CrowdsimError(f"{source.name}: figure body needs a run, not a BVH file")
    kinds = getattr(source, "avatar_kinds", np.zeros(len(cast.scales), int))
    skins = None if skin is None or look.figure == "capsules" else SkinCast(cast, skin, kinds)

    spans = []
    for i, shot in enumerate(shots):
        try:
            spans.append(shot.span.resolve(source.frame_count, source.fps))
        except TakeError as error:
            raise TakeError(f"shots[{i}]: {error}") from None

    def stage(source: PoseSource, scale: int, finer: Stage | None = None) -> Stage:
        """Return the stage of the source at a multiple of its rate."""
        seen = [[_slowed(tracks[one], scale) for one in several] for several in cameras]
        if not shots:
            return Stage(source, cast, skins, tuple(seen[0]), size, look, mark, finer)
        edited = EditedSource(source, tuple((start * scale, end * scale) for start, end in spans))
        track = Track(edited.view([one.view for (one,) in seen]), seen[0][0].sun)
        return Stage(edited, cast, skins, (track,), size, look, mark, finer)

    if not look.motion_blur:
        return stage(source, 1)
    at_rate, scale = getattr(source, "at_rate", None), 2 * look.motion_blur
    if at_rate is None:
        raise CrowdsimError(f"{source.name}: motion blur needs a run, not a BVH file")
    return stage(source, 1, stage(at_rate(scale * source.fps), scale))


def _slowed(track: Track, scale: int) -> Track:
    """Return a track for frames that follow one another so many times as fast."""
    return track if scale == 1 else Track(lambda frame: track.view(frame / scale), track.sun)
