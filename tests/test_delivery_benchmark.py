"""The benchmark of delivery sees how deep a hand is in a body, also where most of it is near the surface."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from trimesh.creation import icosphere

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("apart", [0.20, 0.17, 0.15, 0.12, 0.10])
def test_a_ball_is_as_deep_in_another_one_as_its_deepest_point(monkeypatch: pytest.MonkeyPatch, apart: float) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    depths_in = importlib.import_module("delivery").depths_in
    head, glove = icosphere(3, 0.1), icosphere(3, 0.06)
    way = np.array([0.36, 0.48, 0.8])
    points = glove.vertices + apart * way
    depths, nearest = depths_in(points, np.asarray(head.triangles))
    assert depths.max() == pytest.approx(0.16 - apart, abs=0.002)
    middles = np.asarray(head.triangles_center)[nearest]
    assert (np.linalg.norm(middles - 0.1 * points / np.linalg.norm(points, axis=1)[:, None], axis=1) < 0.02).all()
