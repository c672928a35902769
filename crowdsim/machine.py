"""The machine that a command runs on: processor, versions of packages, and memory."""

from __future__ import annotations

import os
import platform
import sys
from functools import cache
from importlib import metadata
from typing import Any

from crowdsim import __version__

_PACKAGES = ("numpy", "scipy", "numba", "zarr", "pydantic", "open3d-cpu", "open3d", "imageio-ffmpeg")


@cache
def describe_machine() -> dict[str, Any]:
    """Return what a run's figures depend on: processor, system, Python and packages."""
    versions = {"crowdsim": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    machine = {"system": platform.platform(), "processor": _processor(), "cores": os.cpu_count()}
    return {"versions": versions, "machine": machine}


def _processor() -> str:
    return _field("/proc/cpuinfo", "model name") or platform.processor() or platform.machine()


def peak_memory() -> int | None:
    """Return the most memory that this process has held [bytes]; None where the system does not report it."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(peak if sys.platform == "darwin" else peak * 1024)


def available_memory() -> int | None:
    """Return how much memory is free for programs [bytes]; None where the system does not report it."""
    kilobytes = _field("/proc/meminfo", "MemAvailable").split(" ")[0]
    return int(kilobytes) * 1024 if kilobytes.isdecimal() else None


def _field(path: str, name: str) -> str:
    """Return what a file of the system says behind a name; an empty text where it says nothing."""
    try:
        with open(path, encoding="utf-8") as file:
            return next((line.split(":", 1)[1].strip() for line in file if line.startswith(name)), "")
    except (OSError, ValueError):
        return ""
