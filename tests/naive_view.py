"""Recordings of the player read again, track by track and number by number, as crowdsim/view/blocks.py says."""

from __future__ import annotations

import base64
import json
import re
import struct
import zlib
from typing import Any

import numpy as np

from crowdsim.motion import quaternion


def unpack_scene(packed: bytes) -> dict[str, Any]:
    """The document, with its tables as arrays."""
    data = zlib.decompress(packed)
    (length,) = struct.unpack("<I", data[:4])
    scene = json.loads(data[4 : 4 + length])
    base = 4 + length
    scene["tables"] = {
        name: np.frombuffer(data, f"<{kind}", count, base + at) for name, (kind, count, at) in scene["tables"].items()
    }
    return scene


def _track(data: bytes, at: int, plane: int, planes: int, frames: int) -> list[int]:
    values, value, step = [], 0, 0
    for t in range(frames):
        coded = sum(data[at + t + k * plane] << 8 * k for k in range(planes))
        step += (coded >> 1) ^ -(coded & 1)
        value += step
        values.append(value)
    return values


def unpack_block(packed: bytes, bits: list[list[int]], moving: list[int], counts: list[int], frames: int, step: float):
    """For each figure places (F, n, M, 3) [m] and normalised rotations (F, n, J, 4)."""
    data, at, found = zlib.decompress(packed), 0, []
    for widths, moves, count in zip(bits, moving, counts, strict=True):
        joints = count * len(widths)
        left_out = data[at : at + joints]
        at += joints
        plane = frames * sum(3 if one < 4 else 4 for one in left_out)
        rotations = np.zeros((frames, joints, 4))
        for joint, without in enumerate(left_out):
            whole = 2 ** (widths[joint % len(widths)] - 1) - 1
            for k in range(4):
                if k != without:
                    rotations[:, joint, k] = np.array(_track(data, at, plane, 2, frames)) / whole
                    at += frames
            if without < 4:
                rotations[:, joint, without] = np.sqrt(np.maximum(1 - (rotations[:, joint] ** 2).sum(axis=-1), 0))
        at += plane
        places = np.zeros((frames, count * moves * 3))
        for i in range(places.shape[1]):
            places[:, i] = step * np.array(_track(data, at + i * frames, places.shape[1] * frames, 4, frames))
        at += 4 * places.size
        rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
        found.append((places.reshape(frames, count, moves, 3), rotations.reshape(frames, count, -1, 4)))
    assert at == len(data)
    return found


def embedded(page: str) -> tuple[dict[str, Any], list[bytes]]:
    """The scene in a page, and its blocks."""
    source = json.loads(re.search(r'<script type="application/json" id="source">(.*?)</script>', page)[1])
    blocks = re.findall(r'<script type="text/plain" id="block-(\d+)">(.*?)</script>', page)
    assert [int(number) for number, _ in blocks] == list(range(len(blocks)))
    return unpack_scene(base64.b64decode(source["scene"])), [base64.b64decode(text) for _, text in blocks]


def joints_of(scene: dict[str, Any], figure: int, places, rotations) -> np.ndarray:
    """Positions of joints in the world. Shape (F, n, J, 3)."""
    described, tables = scene["figures"][figure], scene["tables"]
    members = np.flatnonzero(tables["figure"] == figure)
    sizes = tables["scale"][members, None] * tables["stretch"].reshape(-1, 3)[members]
    offsets, parents = np.reshape(described["offsets"], (-1, 3)), described["parents"]
    turned = rotations.copy()
    positions = np.zeros((*rotations.shape[:3], 3))
    for joint, parent in enumerate(parents):
        if joint in described["moving"]:
            local = places[:, :, described["moving"].index(joint)]
        else:
            local = offsets[joint] * sizes[:, described["segments"][parent], None] + np.zeros((len(places), 1, 3))
        if parent < 0:
            positions[:, :, joint] = local
            continue
        positions[:, :, joint] = positions[:, :, parent] + quaternion.rotate(turned[:, :, parent], local)
        turned[:, :, joint] = quaternion.multiply(turned[:, :, parent], rotations[:, :, joint])
    return positions


def read_joints(scene: dict[str, Any], blocks: list[bytes]) -> list[np.ndarray]:
    """Positions of the joints of each figure's avatars over all frames."""
    counts = [int((scene["tables"]["figure"] == figure).sum()) for figure in range(len(scene["figures"]))]
    bits = [figure["bits"] for figure in scene["figures"]]
    moving = [len(figure["moving"]) for figure in scene["figures"]]
    found: list[list[np.ndarray]] = [[] for _ in counts]
    for number, block in enumerate(blocks):
        frames = min(scene["block"], scene["frames"] - number * scene["block"])
        for figure, (places, rotations) in enumerate(unpack_block(block, bits, moving, counts, frames, scene["step"])):
            found[figure].append(joints_of(scene, figure, places, rotations))
    return [np.concatenate(parts) for parts in found]
