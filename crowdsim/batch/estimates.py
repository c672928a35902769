"""What runs take before they are begun: room on disk, memory and time, from measured costs."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from crowdsim.errors import BatchError
from crowdsim.preparation.prepare import estimate_needs
from crowdsim.scenario.output import Extent
from crowdsim.scenario.outputs import Outputs

# Bytes that a run takes beside its take and outputs, and seconds that one core takes for a run beside its frames, and
# for a control frame of an avatar. Measured with the shipped scenarios, rounded up.
_RUN_BYTES, _RUN_SECONDS, _CONTROL_SECONDS = 100e3, 0.2, 2e-6


@dataclass(frozen=True)
class Estimate:
    """What a run takes.

    Attributes:
        bytes: Room on disk, outputs included [bytes].
        memory: Memory of the process [bytes].
        seconds: Time on one core [s].
    """

    bytes: float
    memory: float
    seconds: float


def estimate(avatars: int, control_frames: int, control_rate: float, outputs: Outputs) -> Estimate:
    """Return what a run takes.

    Args:
        avatars: Number of avatars.
        control_frames: Control frames.
        control_rate: Control frames a second.
        outputs: Its outputs, resolved.
    """
    memory, size = estimate_needs(avatars, control_frames)
    size += _RUN_BYTES
    seconds = _RUN_SECONDS + _CONTROL_SECONDS * avatars * control_frames
    for output in outputs.wanted():
        more, time = output.cost(Extent(avatars, control_frames, control_rate))
        size, seconds = size + more, seconds + time
    return Estimate(size, memory, seconds)


def check_disk(folder: Path, estimates: Iterable[Estimate]) -> None:
    """Refuse runs for which the disk has no room.

    Raises:
        BatchError: It has not.
    """
    needed = sum(one.bytes for one in estimates)
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(existing).free
    if needed > free:
        what = f"the runs take about {needed / 1e9:.1f} GB, and {free / 1e9:.1f} GB are free in {existing}"
        raise BatchError(f"{folder}: {what}; expected fewer runs or outputs, or --out on another disk")
