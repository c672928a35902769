"""Files of labelled point clouds: binary PLY, written directly, and PCD through Open3D's tensor API."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import OutputError, RunError

FIELDS = ("x", "y", "z", "nx", "ny", "nz", "vx", "vy", "vz", "avatar", "team", "joint")
"""What every point has: position [m], normal, velocity [m/s], float32; avatar, team and joint numbers, int32."""
_LABELS = FIELDS.index("avatar")
_SYSTEM_PACKAGES = "libgl1 libegl1 libgomp1 libusb-1.0-0 libx11-6"


@dataclass(frozen=True)
class Cloud:
    """Points of a frame; n of them.

    Attributes:
        rows: The columns of ``FIELDS`` as a file has them, four bytes each. Shape (n, 12), little-endian float32, of
            which the last three are views of int32.
    """

    rows: Array

    @classmethod
    def empty(cls, points: int) -> Cloud:
        """Return a cloud whose columns are to be written."""
        return cls(np.empty((points, len(FIELDS)), "<f4"))

    @property
    def values(self) -> Array:
        """Positions [m], normals and velocities [m/s]. Shape (n, 9), float32."""
        return self.rows[:, :_LABELS]

    @property
    def labels(self) -> Array:
        """Numbers of avatar, team and joint; negative on obstacles. Shape (n, 3), int32."""
        return self.rows.view("<i4")[:, _LABELS:]

    @property
    def positions(self) -> Array:
        """Positions [m]. Shape (n, 3), float32."""
        return self.rows[:, :3]

    @property
    def normals(self) -> Array:
        """Outward normals. Shape (n, 3), float32."""
        return self.rows[:, 3:6]

    @property
    def velocities(self) -> Array:
        """Velocities [m/s]. Shape (n, 3), float32."""
        return self.rows[:, 6:9]

    @property
    def avatar(self) -> Array:
        """Avatar that each point is on. Shape (n,), int32."""
        return self.labels[:, 0]

    @property
    def team(self) -> Array:
        """Team of that avatar. Shape (n,), int32."""
        return self.labels[:, 1]

    @property
    def joint(self) -> Array:
        """Joint that each point rides on, a number of its skeleton. Shape (n,), int32."""
        return self.labels[:, 2]


def write_cloud(path: Path, cloud: Cloud) -> None:
    """Write a cloud as binary PLY or PCD, by its name's end, under a temporary name that is then renamed.

    Raises:
        OutputError: It cannot be written.
    """
    partial = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        if path.suffix == ".ply":
            with open(partial, "wb") as file:
                file.write(_ply_header(len(cloud.rows)))
                file.write(cloud.rows.data)
        elif not len(cloud.rows):
            # Open3D writes no cloud without points.
            partial.write_bytes(_empty_pcd())
        else:
            _write_pcd(partial, cloud)
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None


def _ply_header(points: int) -> bytes:
    kinds = ("float",) * _LABELS + ("int",) * (len(FIELDS) - _LABELS)
    lines = ["ply", "format binary_little_endian 1.0", "comment crowdsim: metres, y up, metres per second"]
    lines += [f"element vertex {points}", *map("property {} {}".format, kinds, FIELDS), "end_header", ""]
    return "\n".join(lines).encode()


def _empty_pcd() -> bytes:
    """Return a PCD file without points."""
    kinds = ["F"] * _LABELS + ["I"] * (len(FIELDS) - _LABELS)
    lines = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", f"FIELDS {' '.join(FIELDS)}"]
    lines += [
        "SIZE" + " 4" * len(FIELDS),
        f"TYPE {' '.join(kinds)}",
        "COUNT" + " 1" * len(FIELDS),
        "WIDTH 0",
        "HEIGHT 1",
    ]
    return "\n".join([*lines, "VIEWPOINT 0 0 0 1 0 0 0", "POINTS 0", "DATA binary", ""]).encode()


def _write_pcd(path: Path, cloud: Cloud) -> None:
    """Write a cloud through Open3D, which drops attributes of three columns other than positions from PCD files."""
    import open3d

    o3d: Any = open3d
    points = o3d.t.geometry.PointCloud()
    points.point.positions = o3d.core.Tensor.from_numpy(np.ascontiguousarray(cloud.positions))
    for column, name in enumerate(FIELDS[3:], 3):
        values = cloud.rows if column < _LABELS else cloud.rows.view("<i4")
        points.point[name] = o3d.core.Tensor.from_numpy(np.ascontiguousarray(values[:, column : column + 1]))
    # Open3D calls some files written that a full disk has cut off.
    if not (o3d.t.io.write_point_cloud(str(path), points) and _is_whole(path, len(cloud.rows))):
        raise OSError("the disk may be full, or the folder cannot be written")


def _is_whole(path: Path, points: int) -> bool:
    """Whether a binary PCD file holds as many bytes as its points need after the header."""
    end = b"DATA binary\n"
    with open(path, "rb") as file:
        head = file.read(4096)
    return end in head and path.stat().st_size == head.index(end) + len(end) + 4 * len(FIELDS) * points


@cache
def begin_probe() -> subprocess.Popen[str]:
    """Begin to try Open3D in a process of its own, since without its system libraries it can take the process down."""
    return subprocess.Popen(
        [sys.executable, "-c", "import open3d"],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@cache
def probe_open3d() -> None:
    """Wait until Open3D has been tried, see ``begin_probe``.

    Raises:
        RunError: It cannot be imported; the message says what is missing.
    """
    probe = begin_probe()
    _, complaint = probe.communicate()
    if probe.returncode:
        lines = complaint.strip().splitlines()
        why = lines[-1] if lines else f"it ended with {probe.returncode}"
        raise RunError(f"PCD clouds need Open3D, which cannot be loaded: {why}; on Debian: {_SYSTEM_PACKAGES}")
