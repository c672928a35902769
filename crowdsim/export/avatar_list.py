"""The list of avatars beside exported files: who is in them, from which frame to which, and what each one is like."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.body.looks import build_of
from crowdsim.core.types import Array

if TYPE_CHECKING:
    from crowdsim.poses.sampler import PoseSampler

COLUMNS = ("number", "name", "team", "type", "first_frame", "last_frame", "frames", "scale", "build", "file")
"""Its columns. Frames are output frames of the run, counted from 0; ``frames`` says in how many the avatar is there."""
_AT_ONCE = 4_000_000
"""Avatar-frames of a take that are read at once."""


def avatar_list(
    sampler: PoseSampler, avatars: Sequence[int], frames: tuple[int, int], fps: float, file_of: Callable[[str], str]
) -> str:
    """Return a list of avatars as CSV, in the order of their numbers.

    Frames and file are empty for an avatar that is never there, the file for outputs whose files hold all avatars.

    Args:
        sampler: Poses of the take.
        avatars: Numbers of the avatars, ascending.
        frames: First output frame and one past the last; there is at least one.
        fps: Output frames a second.
        file_of: Returns the file that holds the avatar of a name.
    """
    cast = sampler.take.cast
    chosen = np.asarray(avatars, np.int64)
    firsts, lasts, counts = _stays(sampler, chosen, np.arange(*frames), fps)
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for number, first, last, count in zip(chosen.tolist(), firsts, lasts, counts, strict=True):
        name = str(cast.names[number])
        table.writerow([
            number, name, cast.team_names[cast.teams[number]], cast.type_names[cast.types[number]],
            *((first, last) if count else ("", "")), count,
            f"{cast.scales[number]:.6g}", build_of(cast, number).kind,
            file_of(name) if count else "",
        ])  # fmt: skip
    return text.getvalue()


def _stays(sampler: PoseSampler, avatars: Array, frames: Array, fps: float) -> tuple[Array, Array, Array]:
    """Return the first and the last of output frames (T,) in which avatars (n,) are there, and in how many they are."""
    control, counts = np.unique(sampler.control_frames(frames, fps), return_counts=True)
    stops = frames[0] + np.cumsum(counts)
    firsts, lasts, totals = (np.full(len(avatars), value, np.int64) for value in (frames[-1] + 1, -1, 0))
    step = max(1, _AT_ONCE // sampler.take.avatar_count)
    for low in range(0, len(control), step):
        rows = slice(low, low + step)
        first = int(control[low])
        there = (
            np.asarray(sampler.take.action[first : int(control[rows][-1]) + 1])[control[rows] - first][:, avatars] >= 0
        )
        starts, ends = (stops - counts)[rows, None], stops[rows, None] - 1
        firsts = np.minimum(firsts, np.where(there, starts, frames[-1] + 1).min(axis=0))
        lasts = np.maximum(lasts, np.where(there, ends, -1).max(axis=0))
        totals += counts[rows] @ there
    return firsts, lasts, totals
