"""Fingerprints: what a bundle was made from, so that one that is stale is found out."""

from __future__ import annotations

import glob
import hashlib
import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from crowdsim.assets import sources_hash
from crowdsim.bvh.people import split_person
from crowdsim.core.types import FileName
from crowdsim.errors import PolicyError, nearest
from crowdsim.policy.bundle import canonical, file_hash
from crowdsim.training.recipe import Recipe, plain

SOURCES = ("core", "motion", "bvh", "capture", "performer", "graph", "policy", "training")
"""Folders of the package whose code decides what a bundle holds."""
FIGHTS = ("scenario", "crowd", "self_play")
"""Those that decide it too where avatars learn in fights."""

_SHOWN = 4


def capture_folder(recipe: Recipe, mocap: FileName | None = None) -> Path:
    """Return the folder of a recipe's capture: the given one, else the recipe's, else that of ``CROWDSIM_MOCAP``.

    Raises:
        PolicyError: None is known, or the one that is known does not exist.
    """
    capture = recipe.motion.capture
    own = capture.folder if capture is not None else None
    if own is not None and not mocap and not Path(own).is_dir():
        raise PolicyError(f"motion.capture.folder: {own}: no such folder; change it, or give --mocap DIR")
    known = mocap or own or os.environ.get("CROWDSIM_MOCAP")
    if not known:
        raise PolicyError(
            "motion.capture.clips: needs motion capture, expected its folder by --mocap DIR or in CROWDSIM_MOCAP"
        )
    if not Path(known).is_dir():
        raise PolicyError(f"{known}: no such folder, expected motion capture (--mocap DIR or CROWDSIM_MOCAP)")
    return Path(known)


def capture_files(recipe: Recipe, mocap: FileName | None = None) -> list[Path]:
    """Return the BVH files that a recipe's names and patterns find, in the order of these, each once.

    Raises:
        PolicyError: There is no folder of capture, or a name or pattern finds nothing in it.
    """
    if recipe.motion.capture is None:
        return []
    folder = capture_folder(recipe, mocap)
    found: dict[Path, None] = {}
    missing = []
    for pattern in recipe.motion.capture.clips:
        literal = os.path.isfile(split_person(folder / pattern)[0])
        names = [pattern] if literal else sorted(glob.glob(pattern, root_dir=folder, recursive=True))
        files = [folder / name for name in names if literal or os.path.isfile(folder / name)]
        if not files:
            missing.append(pattern)
        found.update(dict.fromkeys(files))
    if missing:
        raise PolicyError(_describe_missing(folder, missing))
    # One of several people is not read again where the whole file is.
    return [path for path in found if path.is_file() or split_person(path)[0] not in found]


def bvh_files(folder: Path) -> list[Path]:
    """Return the BVH files in a folder and all folders in it, by name; hidden ones are left out."""
    files = [path.relative_to(folder) for path in folder.rglob("*") if path.suffix.lower() == ".bvh" and path.is_file()]
    return [folder / path for path in sorted(files) if not any(part.startswith(".") for part in path.parts)]


def _describe_missing(folder: Path, patterns: list[str]) -> str:
    """Return in words which patterns find nothing in a folder, what is in it, and how it can be trained on."""
    there = [path.relative_to(folder).as_posix() for path in bvh_files(folder)]
    some = ", ".join(map(repr, patterns[:_SHOWN])) + (f" and {len(patterns) - _SHOWN} more" * (len(patterns) > _SHOWN))
    text = f"{folder}: holds nothing like {some}, named in motion.capture.clips"
    if not there:
        return f"{text}; it holds no BVH"
    names = ", ".join(there[:_SHOWN]) + (", ..." if len(there) > _SHOWN else "")
    hint = nearest(patterns[0], there)
    files = "1 BVH file" if len(there) == 1 else f"{len(there)} BVH files"
    return (
        f"{text}{hint}; it holds {files}: {names}; to train on them in any layout: "
        f"crowdsim train --mocap {shlex.quote(str(folder))} --name NAME"
    )


def fingerprints_of(recipe: Recipe, files: Sequence[Path] | None) -> dict[str, str]:
    """Return the fingerprint of the recipe, of the capture it trains on, and of the code that trains.

    Without ``files`` that of the capture is left out.
    """
    folders = SOURCES if recipe.defend is None else SOURCES + FIGHTS
    prints = {"recipe": _hash(canonical(plain(recipe))), "sources": sources_hash(folders)}
    if files is not None:
        prints["capture"] = _hash(canonical([[path.name, file_hash(split_person(path)[0])] for path in files]))
    return prints


def combine(prints: Mapping[str, str]) -> str:
    """Return one fingerprint for all."""
    return _hash(canonical(dict(prints)))


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
