"""Fingerprints: what a bundle was made from, so that one that is stale is found out."""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from crowdsim.errors import PolicyError, nearest
from crowdsim.policy.bundle import canonical, file_hash
from crowdsim.policy.recipe import Recipe, plain

SOURCES = ("motion", "graph", "policy")
"""Folders of the package whose code decides what a bundle holds."""


def capture_files(recipe: Recipe, mocap: str | os.PathLike[str] | None) -> list[Path]:
    """Return the BVH files that a recipe's patterns name, in the order of the patterns, each once.

    Raises:
        PolicyError: There is no folder of capture, or a pattern names nothing in it.
    """
    if recipe.motion.capture is None:
        return []
    if mocap is None or not str(mocap):
        raise PolicyError(
            "motion.capture.clips: needs motion capture, expected its folder by --mocap DIR or in CROWDSIM_MOCAP"
        )
    folder = Path(mocap)
    if not folder.is_dir():
        raise PolicyError(f"{folder}: no such folder, expected motion capture (--mocap DIR or CROWDSIM_MOCAP)")
    found: dict[Path, None] = {}
    for pattern in recipe.motion.capture.clips:
        names = sorted(glob.glob(pattern, root_dir=folder, recursive=True))
        files = [folder / name for name in names if (folder / name).is_file()]
        if not files:
            there = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.bvh"))
            hint = nearest(pattern, there) or (
                f"; there are {len(there)} BVH files in it" if there else "; it holds no BVH"
            )
            raise PolicyError(f"{folder}: holds nothing like {pattern!r}, named in motion.capture.clips{hint}")
        found.update(dict.fromkeys(files))
    return list(found)


def fingerprints_of(recipe: Recipe, files: Sequence[Path] | None) -> dict[str, str]:
    """Return the fingerprint of the recipe, of the capture it trains on, and of the code that trains.

    Without ``files`` that of the capture is left out.
    """
    prints = {"recipe": _hash(canonical(plain(recipe))), "sources": sources_hash()}
    if files is not None:
        prints["capture"] = _hash(canonical([[path.name, file_hash(path)] for path in files]))
    return prints


def combine(prints: Mapping[str, str]) -> str:
    """Return one fingerprint for all."""
    return _hash(canonical(dict(prints)))


def sources_hash() -> str:
    """Return the fingerprint of the package's code for motion, graph and policy."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for name in SOURCES:
        for path in sorted((package / name).glob("*.py")):
            digest.update(f"{name}/{path.name}\n".encode())
            digest.update(path.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
