"""Traps for a command in a process of its own: it is killed at a chosen step of its simulation or of what it writes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from typing import Any

from crowdsim.runs import checkpoint, recording
from crowdsim.take import store

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
    store.TakeWriter._put = _before(store.TakeWriter._put, lambda: passing("array"))
    os.replace = _before(os.replace, lambda: passing("checkpoint"), f".{checkpoint.NAME}.part")


def _before(call: Callable[..., Any], do: Callable[[], None], name: str = "") -> Callable[..., Any]:
    """Return a function that first does something, where a name is given if its first argument is a file called so."""

    def changed(first: Any, *rest: Any, **named: Any) -> Any:
        if not name or os.path.basename(first) == name:
            do()
        return call(first, *rest, **named)

    return changed
