"""Traps for a command in a process of its own: it is killed at a chosen step of its simulation or of what it writes."""

from __future__ import annotations

import os
import signal
from typing import Any

from crowdsim.core.types import Array
from crowdsim.crowd.events import VARIABLES
from crowdsim.runs import checkpoint, recording
from crowdsim.take import store
from crowdsim.take.array_files import GrowingArray

LOG = "simulated.txt"
"""File in the working folder: the first control frame of each step, and how many there were."""


def set_trap(avatar_frames: int, events: int, place: str = "", number: int = 0) -> None:
    """Let this process simulate in small steps and note them, and be killed at the n-th time that it is at a place.

    Args:
        avatar_frames: Avatar-frames of a step.
        events: Strikes in a chunk of the take.
        place: ``step`` of the simulation, which is lost; ``array`` of the take that frames are written to;
            ``checkpoint`` that is written, but has no name yet; nowhere when empty.
        number: Which time, from 1.
    """
    recording._STEP_AVATAR_FRAMES = avatar_frames
    store.EVENTS_A_CHUNK = events
    passed = {"step": 0, "array": 0, "checkpoint": 0}

    def passing(name: str) -> None:
        passed[name] += 1
        if name == place and passed[name] == number:
            os.kill(os.getpid(), signal.SIGKILL)

    class Noting(recording.Simulation):
        def run(self, frames: int) -> Any:
            first = self.frame
            chunk = super().run(frames)
            with open(LOG, "a", encoding="utf-8") as file:
                file.write(f"{first} {self.frame - first}\n")
            passing("step")
            return chunk

    recording.Simulation = Noting

    append, replace = GrowingArray.append, os.replace

    def noting_append(array: GrowingArray, values: Array) -> None:
        if array.name in VARIABLES and len(values):
            passing("array")
        append(array, values)

    def noting_replace(source: Any, *rest: Any, **named: Any) -> None:
        if os.path.basename(source) == f".{checkpoint.NAME}.part":
            passing("checkpoint")
        replace(source, *rest, **named)

    GrowingArray.append = noting_append
    os.replace = noting_replace
