"""Runs that have been done, as Python has them: takes that know their policies, and export and draw themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array, FileName, Progress
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError, OutputError, TakeError
from crowdsim.files import exists_plain
from crowdsim.places.kernels.records import PART
from crowdsim.runs.folder import RESOLVED, place_of, read_resolved
from crowdsim.scenario.camera import Camera
from crowdsim.scenario.cameras import Chosen
from crowdsim.scenario.frame_ranges import parse_frames
from crowdsim.scenario.heals import Heal, find_heals
from crowdsim.scenario.output import FPS, Output
from crowdsim.scenario.rates import parse_rate
from crowdsim.scenario.scenario import Scenario
from crowdsim.take.take import Take

if TYPE_CHECKING:
    from crowdsim.export.posed import FinishedTake
    from crowdsim.render.look import Look
    from crowdsim.render.take_source import TakeSource
    from crowdsim.view.page import Page
    from crowdsim.view.recording import Recording

VIEW_FPS = 60.0
"""Frames a second of recordings: between those of a lower rate fists are centimetres away from where they were."""


@dataclass(frozen=True)
class RecordedRun(Take):
    """A run that has been done: its take with its policies; it exports and draws itself.

    Attributes:
        folder: The run folder; None of a run in memory.
        notes: What a user should know of it.
        arena: The arena of its scenario, see ``Crowd.arena``, which pictures show. Shape (5,).
        obstacles: Parts of its scenario's obstacles, whose doors open by seconds. Shape (n,), ``PART``.
        fps: Frames a second of outputs, as its scenario says.
        cameras: Cameras of its scenario by name.
        health: Health at the start of avatars that can be hurt, by the names of their types [points].
        heals: When health is restored, see ``scenario.heals.find_heals``.
    """

    folder: Path | None = None
    notes: tuple[str, ...] = ()
    arena: Array = field(default_factory=lambda: np.zeros(5))
    obstacles: Array = field(default_factory=lambda: np.zeros(0, PART))
    fps: float = FPS
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    health: Mapping[str, float] = field(default_factory=dict)
    heals: Sequence[Heal] = ()

    @classmethod
    def of(cls, take: Take, **more: Any) -> RecordedRun:
        """Return the run of a take; ``more`` are further fields."""
        return cls(**{**{one.name: getattr(take, one.name) for one in fields(take)}, **more})

    def source(self, fps: float, threads: int = CORES) -> TakeSource:
        """Return it as a source of pictures."""
        from crowdsim.render.take_source import TakeSource

        return TakeSource(
            self, self.policies, fps, threads=threads, arena=self.arena, cameras=self.cameras, obstacles=self.obstacles
        )

    def outputs_in(
        self, folder: Path, threads: int, progress: Progress | None, scenario: str, timings: Array | None = None
    ) -> FinishedTake:
        """Return it as what outputs are written from, into a folder."""
        from crowdsim.export.posed import FinishedTake

        return FinishedTake(
            self, self.policies, folder, threads, progress, self.arena, timings, self.obstacles, self.cameras,
            self.health, self.heals, scenario,
        )  # fmt: skip

    @property
    def take(self) -> RecordedRun:
        """The take, which is the run itself."""
        return self

    def export(
        self,
        kinds: str | Sequence[str],
        out: FileName | None = None,
        avatars: ArrayLike | None = None,
        frames: str | tuple[int, int] | None = None,
        fps: str | float | Fraction | None = None,
        threads: int = CORES,
        progress: Progress | None = None,
        force: bool = False,
        **keys: Any,
    ) -> list[Path]:
        """Write files of the run: the same bytes as those that its scenario or the command line asks for.

        Args:
            kinds: ``bvh``, ``ply``, ``pcd``, ``csv``, ``glb`` or ``clips``, or several of them; PCD needs Open3D.
            out: Folder for a folder of each kind; by default the run folder, where they replace those of their kind.
            avatars: Numbers or names, or text such as ``0-9``; all when None.
            frames: Output frames, half-open: text such as ``0:120`` or ``2s:5s``, or two numbers; all when None.
            fps: Output frames a second, a fraction such as ``24000/1001`` too; those of its scenario when None.
            threads: Threads; the files do not depend on them.
            progress: Called with stage, done and total.
            force: Whether to do it again although it is done, and to replace exports in another folder.
            **keys: Other keys of these outputs in scenarios, such as ``every`` or ``points``.

        Returns:
            The files, by kinds.

        Raises:
            CrowdsimError: There is no such kind or key.
            TakeError: Avatars or frames are not in the take, or the manifest is damaged.
            OutputError: A folder cannot be made or is in use, or holds other files of these names.
            RunError: A file cannot be written.
        """
        from crowdsim.runs.exports import choose_outputs

        wanted = (kinds,) if isinstance(kinds, str) else tuple(kinds)
        numbers = self._chosen(avatars)
        chosen = None if numbers is None else ",".join(map(str, numbers))
        outputs = choose_outputs(self, wanted, self.fps if fps is None else fps, _range_text(frames), chosen, **keys)
        return list(chain(*self.write(outputs, self._place(out), threads, progress, force).values()))

    def write(
        self,
        outputs: Sequence[Output],
        out: Path,
        threads: int = 1,
        progress: Progress | None = None,
        force: bool = False,
    ) -> dict[str, list[Path]]:
        """Write outputs into the run folder or another one; return the files of each.

        What an interrupted command has finished is kept for the same one, and removed by another. Outputs are those of
        ``runs.exports``; arguments and errors are those of ``export``.

        Raises:
            TakeError: A report shows the scenario, which cannot be read.
            CrowdsimError: An output does not fit the policies, or a page would be too large.
        """
        from crowdsim.export.posed import extent_of, file_names
        from crowdsim.runs.exports import take_mark, wanted_files, write_outputs
        from crowdsim.runs.stage import planned_files, write_together

        for output in outputs:
            for finding in output.findings_with(self.policies):
                raise CrowdsimError(f"{output.name}: {finding}")
        folder, names, made_from = self.folder or out, self.cast.names.tolist(), {"take": take_mark(self)}
        if any(output.name == "report" for output in outputs):
            made_from["of"] = read_resolved(place_of(folder))
            if not made_from["of"]:
                raise TakeError(f"{folder / RESOLVED}: cannot be read, and the report shows it")
        wanted = wanted_files(outputs, planned_files(outputs, extent_of(self), names, self.scenario), made_from)
        with write_together(out, wanted, folder, force, threads) as writing:
            if not writing.done:
                write_outputs(self.outputs_in(writing.folder, threads, progress, made_from.get("of", "")), outputs)
        found = {output.name: file_names(output, extent_of(self), names) for output in outputs}
        # Avatars that never came have no file.
        return {kind: [out / name for name in files if exists_plain(out, name)] for kind, files in found.items()}

    def render(
        self,
        out: FileName | None = None,
        frames: str | tuple[int, int] | None = None,
        camera: Chosen | None = None,
        size: str | tuple[int, int] = "1280x720",
        fps: str | float | Fraction | None = None,
        mp4: bool | None = None,
        png: bool = False,
        contact_sheet: int = 0,
        caption: bool = True,
        look: Look | None = None,
        shots: Sequence[Any] = (),
        threads: int = CORES,
        jobs: int = 1,
        progress: Progress | None = None,
        force: bool = False,
    ) -> list[Path]:
        """Draw the run, as the command ``render`` does.

        Args:
            out: Folder of the pictures; by default the run folder.
            frames: Pictures, half-open: text such as ``0:120`` or ``2s:5s``, or two numbers; all when None.
            camera: A kind such as ``fight``, ``follow:AVATAR`` with a number or name, the name of one of the scenario's
                cameras, ``FILE.yaml#NAME``, or a ``scenario.camera.Camera``.
            size: Width and height [px].
            fps: Pictures a second, a fraction too; those of its scenario when None.
            mp4: Whether to write ``video.mp4``; when None, where nothing else is asked for.
            png: Whether to write every picture as PNG, into the folder ``frames``.
            contact_sheet: Number of moments in ``contact_sheet.png``; 0 for none.
            caption: Whether pictures have a small caption.
            look: Light, background and marks (``render.look.Look``).
            shots: Shots of an edited video (``scenario.cameras.Shot``) instead of the camera.
            threads: Threads; pictures do not depend on them.
            jobs: Processes that share the pictures.
            progress: Called with stage, done and total.
            force: Whether pictures in another folder may be replaced.

        Returns:
            The files.

        Raises:
            CrowdsimError: The camera, an avatar or the size is invalid.
            TakeError: Frames are not in the take.
            OutputError: A folder cannot be made or is in use, or holds other files of these names.
            RunError: A file cannot be written.
        """
        from crowdsim.render.batch import render
        from crowdsim.render.command import parse_size
        from crowdsim.render.look import Look
        from crowdsim.render.options import RenderOptions
        from crowdsim.runs.stage import record_pictures

        rate, given = parse_rate(self.fps if fps is None else fps), _range_text(frames)
        options = RenderOptions(
            size=parse_size(size if isinstance(size, str) else "x".join(map(str, size))),
            fps=rate,
            frames=None if given is None else parse_frames(given),
            camera=camera,
            mp4=not (png or contact_sheet) if mp4 is None else mp4,
            png=png,
            contact_sheet=contact_sheet,
            look=replace(look or Look(), caption=caption),
            shots=tuple(shots),
            threads=threads,
            jobs=jobs,
        )
        options.check()
        record = partial(record_pictures, run=self.folder, force=force, threads=threads)
        return list(render(self.source(rate, threads), self._place(out), options, progress, record).files)

    def view(
        self,
        avatars: ArrayLike | None = None,
        frames: str | tuple[int, int] | None = None,
        fps: str | float | Fraction = VIEW_FPS,
        threads: int = CORES,
        progress: Progress | None = None,
    ) -> Page:
        """Return a page that plays the run in a browser, as ``crowdsim view --html`` writes it.

        The page needs no network and no other file. Notebooks show it as the player.

        Args:
            avatars: Numbers or names, or text such as ``0-9``; all when None.
            frames: Output frames, half-open: text such as ``0:120`` or ``2s:5s``, or two numbers; all when None.
            fps: Frames a second, a fraction too.
            threads: Threads; the page does not depend on them.
            progress: Called with stage, done and total.

        Returns:
            The page, which is its text.

        Raises:
            TakeError: Avatars or frames are not in the take.
            CrowdsimError: The page would be too large.
        """
        from crowdsim.view.page import Page, check_size, page_parts

        recording = self.recording(avatars, _range_text(frames), parse_rate(fps), threads)
        check_size(recording)
        return Page(b"".join(page_parts(recording, threads, progress)).decode("utf-8"))

    def recording(
        self, avatars: ArrayLike | None = None, frames: str | None = None, fps: float = VIEW_FPS, threads: int = CORES
    ) -> Recording:
        """Return the run as the player takes it; arguments and errors as of ``view``."""
        from crowdsim.view.take_motion import record_take

        numbers = self._chosen(avatars)
        return record_take(
            self, fps, numbers, frames, threads, self.arena, self.cameras, self.health, self.obstacles, self.heals
        )

    def _chosen(self, avatars: ArrayLike | None) -> list[int] | None:
        """Return the numbers of avatars, ascending; None for all."""
        from crowdsim.export.select import parse_avatars

        if avatars is None or isinstance(avatars, str):
            return parse_avatars(avatars, self.cast)
        return np.unique(self.cast.numbers(avatars)).tolist()

    def _place(self, out: FileName | None) -> Path:
        """Return the folder for files of the run."""
        if out is not None:
            return Path(out)
        if self.folder is None:
            raise OutputError("the run is in memory and has no folder, expected one for its files as 'out'")
        return self.folder


def shown(scenario: Scenario, folder: Path, rate: float) -> dict[str, Any]:
    """Return what pictures and reports show of a scenario, as fields of ``RecordedRun``.

    Args:
        scenario: The scenario, resolved.
        folder: Folder of the files that it names.
        rate: Control frames a second.

    Raises:
        PlanError: A floor plan cannot be read.
    """
    from crowdsim.crowd.draw import pack_arena
    from crowdsim.crowd.obstacles import obstacle_shapes
    from crowdsim.places.arrays import pack_parts

    groups, events = ([one.model_dump() for one in part] for part in (scenario.groups, scenario.events))
    return {
        "arena": pack_arena(scenario.arena),
        "obstacles": pack_parts(obstacle_shapes(scenario.obstacles, scenario.arena, folder), None),
        "fps": scenario.fps,
        "cameras": scenario.cameras,
        "health": {name: one.damage.health for name, one in scenario.types.items() if one.damage is not None},
        "heals": find_heals(groups, events, rate),
    }


def _range_text(frames: str | tuple[int, int] | None) -> str | None:
    """Return a range of frames as text."""
    if frames is None or isinstance(frames, str):
        return frames
    try:
        start, stop = frames
        return f"{int(start)}:{int(stop)}"
    except (TypeError, ValueError):
        raise TakeError(f"frames {frames!r}: expected two numbers, or text such as 0:120 or 2s:5s") from None
