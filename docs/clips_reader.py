"""Poses of any avatar at any time from the files of ``crowdsim export RUN --clips``, with nothing but numpy."""

import json
from fractions import Fraction
from pathlib import Path

import numpy as np

KINDS, WIDTHS = {5126: "<f4", 5122: "<i2", 5120: "i1"}, {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Clips:
    """The clips of a bank, and the tracks that play them."""

    def __init__(self, folder):
        self.tracks = json.loads((Path(folder) / "tracks.json").read_text("utf-8"))
        data, self.clips = (Path(folder) / self.tracks["bank"]).read_bytes(), []
        size = int.from_bytes(data[12:16], "little")
        self.gltf, blob = json.loads(data[20 : 20 + size]), data[28 + size :]
        for clip, animation in zip(self.tracks["clips"], self.gltf["animations"], strict=True):
            count = len(self.tracks["skeletons"][clip["skeleton"]]["joints"])
            joints = self.gltf["skins"][clip["skeleton"]]["joints"][:count]
            rest = [self.gltf["nodes"][joint].get("rotation", [0, 0, 0, 1]) for joint in joints]
            rotations, roots = np.tile(np.array(rest, float), (clip["frames"], 1, 1)), np.zeros((0, 3))
            for channel in animation["channels"]:
                item = self.gltf["accessors"][animation["samplers"][channel["sampler"]]["output"]]
                start = self.gltf["bufferViews"][item["bufferView"]]["byteOffset"] + item.get("byteOffset", 0)
                kind, width = KINDS[item["componentType"]], WIDTHS[item["type"]]
                values = np.frombuffer(blob, kind, item["count"] * width, start).reshape(-1, width).astype(float)
                if channel["target"]["path"] == "translation":
                    roots = values
                elif channel["target"]["node"] in joints:
                    unit = values / np.linalg.norm(values, axis=1, keepdims=True)
                    rotations[:, joints.index(channel["target"]["node"])] = unit
            self.clips.append((rotations, roots, clip["rate"]))
        for track in self.tracks["avatars"]:  # frames, and between these where straight lines would not do
            rows = [(frame, *(row or [np.nan] * 4)) for frame, row in enumerate(track["roots"])]
            track["ground"] = np.array(sorted(rows + [tuple(row) for row in track.get("between", [])])).T

    def play(self, clip, seconds):
        """Rotations and root of a clip; beyond its ends it goes straight on and comes to rest."""
        rotations, roots, rate = self.clips[clip]
        low = int(np.clip(np.floor(seconds * rate), 0, len(roots) - 2))
        part, over = seconds * rate - low, np.clip(seconds * rate - low, 0, 1)
        part = over + 6 * np.tanh((part - over) / 6)
        return [(1 - part) * values[low] + part * values[low + 1] for values in (rotations, roots)]

    def pose(self, track, seconds):
        """Local rotations (x, y, z, w), the root seen from the ground, and the ground: x, lift, z, heading."""
        near = [s for i, s in enumerate(track["segments"]) if s[1] - s[3] <= seconds or not i]
        weights, left = list[float](), 1.0
        for _, start, _, before, after in reversed(near):  # each takes its share of what later ones leave
            step = np.clip((seconds - start + before) / max(before + after, 1e-9), 0, 1)
            weights.insert(0, left * step**3 * (10 - 15 * step + 6 * step**2))
            left -= weights[0]
        rotations, root, sides, weights[0] = 0.0, 0.0, np.ones(1), weights[0] + left
        for i in np.flatnonzero(weights):
            (clip, start, since, *_), (old, begun, by, *_) = near[i], near[i - 1]
            if i and weights[i - 1]:  # of two signs of a quaternion, that which is near where the clips met
                met = self.play(clip, since)[0] * self.play(old, by + (start - begun) * track["speed"])[0]
                sides = sides * np.where(met.sum(axis=1, keepdims=True) < 0, -1, 1)
            turned, placed = self.play(clip, since + (seconds - start) * track["speed"])
            rotations, root = rotations + weights[i] * sides * turned, root + weights[i] * placed
        frame = seconds * float(Fraction(self.tracks["fps"])) - track["first"]
        ground = np.array([np.interp(frame, track["ground"][0], values) for values in track["ground"][1:]])
        return rotations / np.linalg.norm(rotations, axis=1, keepdims=True), root, ground
