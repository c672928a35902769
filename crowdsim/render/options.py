"""How a source is drawn."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, field
from typing import Any

from crowdsim.core.workers import limited
from crowdsim.errors import CrowdsimError, TakeError
from crowdsim.render.look import Look
from crowdsim.render.source import PoseSource
from crowdsim.render.stage import Stage, build_stage
from crowdsim.scenario.cameras import Chosen, camera_name
from crowdsim.scenario.frame_ranges import FrameRange


@dataclass(frozen=True)
class RenderOptions:
    """What to draw of a source, and how.

    Attributes:
        size: Width and height [px], even for a video.
        fps: Pictures a second, at which the source is opened; its own rate when None.
        frames: First frame and the one after the last, either None for that of the source; or a range as a user gives
            it; all when None.
        camera: See ``crowdsim.render.camera.resolve_camera``; that which suits the source when None.
        mp4: Whether to write a video.
        png: Whether to write every frame as PNG.
        contact_sheet: Number of moments on a contact sheet; 0 for none.
        look: Light, background, marks and caption.
        shots: Shots of an edited video instead of the camera, see ``scenario.cameras.Shot``.
        threads: Frames drawn at once in all; as many as there are processors when None.
        jobs: Processes that share the frames.
    """

    size: tuple[int, int] = (1280, 720)
    fps: float | None = None
    frames: FrameRange | tuple[int | None, int | None] | None = None
    camera: Chosen | None = None
    mp4: bool = True
    png: bool = False
    contact_sheet: int = 0
    look: Look = field(default_factory=Look)
    shots: tuple[Any, ...] = ()
    threads: int | None = None
    jobs: int = 1

    @property
    def thread_count(self) -> int:
        """Number of threads."""
        return self.threads or os.cpu_count() or 1

    def check(self) -> None:
        """Raise what no source could be drawn with.

        Raises:
            CrowdsimError: Nothing is to be written, or a number is out of range.
        """
        if self.fps is not None and not 0 < self.fps <= 1000:
            raise CrowdsimError(f"fps is {self.fps}, expected more than 0 and 1000 at the most")
        if not (self.mp4 or self.png or self.contact_sheet):
            raise CrowdsimError("nothing to write, expected --mp4, --png or --contact-sheet")
        if self.mp4 and (self.size[0] % 2 or self.size[1] % 2):
            raise CrowdsimError(f"size {self.size[0]}x{self.size[1]}: a video needs an even width and height")
        if self.look.transparent and self.mp4:
            raise CrowdsimError("a video cannot be transparent, expected --png or --contact-sheet instead of --mp4")
        if self.shots and self.camera is not None:
            raise CrowdsimError("shots have cameras of their own, expected no camera beside them")
        for name, number in (("threads", self.threads), ("jobs", self.jobs)):
            if number is not None and number < 1:
                raise CrowdsimError(f"{name} is {number}, expected 1 or more")

    def frame_range(self, source: PoseSource) -> tuple[int, int]:
        """Return the first frame of a source that is drawn, and the one after the last.

        Raises:
            TakeError: The range is empty or reaches beyond the source.
        """
        count, name = source.frame_count, source.name
        if isinstance(self.frames, FrameRange):
            start, stop = self.frames.resolve(count, source.fps)
        else:
            first, last = self.frames or (None, None)
            start, stop = first or 0, count if last is None else last
        if count < 1:
            raise TakeError(f"{name}: there is no frame to draw")
        if not 0 <= start < stop <= count:
            raise TakeError(f"{name}: frames {start}:{stop} are not there, expected a range within 0:{count}")
        return start, stop

    def facts(self, source: PoseSource) -> dict[str, Any]:
        """Return what is drawn of a source as plain data, which readers see; errors as of ``frame_range``."""
        start, stop = self.frame_range(source)
        camera = f"{len(self.shots)} shots" if self.shots else camera_name(self.camera or "auto")
        size = f"{self.size[0]}x{self.size[1]}"
        return {"size": size, "fps": source.fps, "frames": f"{start}:{stop}", "camera": camera, **asdict(self.look)}

    def stage(self, source: PoseSource) -> Stage:
        """Return a source with everything that its pictures share; errors as of ``build_stage``."""
        with limited(self.thread_count):
            camera = "auto" if self.camera is None else self.camera
            return build_stage(source, self.size, camera, self.look, self.shots)
