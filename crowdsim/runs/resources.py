"""What a run needs of the machine: memory and room on disk."""

from __future__ import annotations

import shutil
from pathlib import Path

from crowdsim.runs.manifest import available_memory

LARGE = 20_000
"""Avatars from which on a run reports beforehand what it needs."""

_BASE_BYTES, _AVATAR_BYTES, _FRAME_BYTES, _DISK_BYTES = 400e6, 1200.0, 6.0, 20.0
"""Memory of a run: of the program and a policy, an avatar, an avatar-frame's strikes; and what a take holds of it on
disk at most. Measured with the shipped crowds, rounded up."""


def needs(avatars: int, frames: int, folder: Path) -> str:
    """Return a sentence on the memory and room on disk that a run takes, and whether there is as much."""
    memory = _BASE_BYTES + avatars * (_AVATAR_BYTES + frames * _FRAME_BYTES)
    room = avatars * frames * _DISK_BYTES
    result = f"{avatars:,} avatars x {frames:,} control frames take up to {memory / 1e9:.1f} GB of memory and "
    result += f"{room / 1e9:.1f} GB on disk, without outputs"
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(existing).free
    available = available_memory()
    if available is not None and memory > available:
        result += f"; only {available / 1e9:.1f} GB of memory are free"
    if room > free:
        result += f"; only {free / 1e9:.1f} GB are free in {existing}"
    return result
