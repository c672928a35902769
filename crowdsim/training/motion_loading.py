"""The motion that a recipe asks for: capture that is read, or the embedded boxer's performance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from crowdsim.core.types import Progress
from crowdsim.motion.database import MotionDatabase
from crowdsim.training.recipe import Recipe


@runtime_checkable
class _TakesNotes(Protocol):
    """Progress that shows what is found, too."""

    def note(self, text: str) -> None:
        """Show a line."""


def load_motion(
    recipe: Recipe, files: Sequence[Path], progress: Progress | None = None, changes: dict[str, str] | None = None
) -> MotionDatabase:
    """Return the motion database that a recipe asks for, from the given files or from the embedded boxer.

    Clips of several skeletons are brought to the one with the longest motion; ``changes`` gets what was changed of
    them, in words, by name.

    Raises:
        MotionError: A file cannot be used: which, and why; or there are no strikes, and a behaviour needs them.
        BvhError: A file is no BVH.
    """
    from crowdsim.capture.loading import Capture, load_people, usable_clips, with_path
    from crowdsim.motion.database import build_database
    from crowdsim.motion.measuring import MeasuredClip, measure_clips
    from crowdsim.motion.retargeting import to_one_skeleton
    from crowdsim.performer.session import perform
    from crowdsim.training.no_strikes_report import require_no_strikes

    performer, source = recipe.motion.performer, recipe.motion.capture
    captures: list[Capture] = []
    clips: list[MeasuredClip] = []
    if performer is not None:
        performed = perform(
            performer.seconds,
            performer.seed,
            recipe.playback_rate,
            performer.stance,
            progress,
            performer.falls,
            performer.rests,
            performer.stick,
        )
        clips = measure_clips([performance.clip for performance in performed])
    else:
        assert source is not None
        for done, path in enumerate(files, start=1):
            people = load_people(path, source.unit, source.up_axis, source.faults)
            captures.extend(people)
            for capture in people:
                if isinstance(progress, _TakesNotes):
                    for finding in capture.findings:
                        progress.note(with_path(finding, capture.clip.source))
                clips.extend(usable_clips(capture, source.strict))
            if progress is not None:
                progress("read capture", done, len(files))
        clips, brought = to_one_skeleton(clips)
        if changes is not None:
            changes.update({name: change.describe() for name, change in brought.items()})
    database = build_database(
        clips,
        recipe.control_rate,
        recipe.playback_rate,
        mirror=recipe.motion.mirror,
        trim=recipe.motion.trim,
        progress=progress,
        limbs=recipe.strikes.numbers(),
        rests=recipe.rest is not None,
        props=recipe.strikes.held(clips[0].body.roles) if clips else (),
    )
    if not len(database.strike_frames):
        require_no_strikes(recipe, captures)
    return database
