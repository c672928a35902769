"""Obstacles as triangles, beside their volumes and distances."""

import math

import numpy as np
import pytest
from naive_places import gap_to

from crowdsim.places.arrays import pack_parts
from crowdsim.places.description import BoxObstacle, DiscObstacle, RopesObstacle, WallObstacle
from crowdsim.places.mesh import POST, ROPE_LEVELS, area_of, mesh_of

WALL = WallObstacle(kind="wall", points=((0.0, 1.0), (3.0, 5.0)), thickness=0.2, height=2.5)
BOX = BoxObstacle(kind="box", centre=(1.0, -2.0), size=(1.5, 0.6), rotation=30.0, height=0.8)
DISC = DiscObstacle(kind="disc", centre=(-2.0, 1.0), radius=0.4, height=1.1)
SQUARE = RopesObstacle(kind="ropes", points=((0.0, 0.0), (0.0, 4.0), (4.0, 4.0)), height=1.3)


def corners_of(shape):
    (part, *_) = pack_parts([(0, shape)], None)
    mesh = mesh_of(part)
    return part, mesh, mesh.positions[mesh.triangles]


@pytest.mark.parametrize(
    ("shape", "volume", "area"),
    [
        (WALL, (5 * 0.2 + math.pi * 0.01) * 2.5, (10 + math.pi * 0.2) * 2.5 + 2 * (1 + math.pi * 0.01)),
        (BOX, 1.5 * 0.6 * 0.8, 2 * (1.5 * 0.6 + 1.5 * 0.8 + 0.6 * 0.8)),
        (DISC, math.pi * 0.16 * 1.1, math.pi * (0.8 * 1.1 + 2 * 0.16)),
    ],
)
def test_surfaces_are_closed_and_have_the_size_of_their_obstacle(shape, volume: float, area: float) -> None:
    part, mesh, corners = corners_of(shape)
    inside = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert inside == pytest.approx(volume, rel=0.01)
    assert area_of(pack_parts([(0, shape)], None)) == pytest.approx(area, rel=0.01)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    assert np.einsum("ij,ikj->ik", flat, mesh.normals[mesh.triangles]).min() > 0.99
    assert (mesh.positions[:, 1].min(), mesh.positions[:, 1].max()) == pytest.approx((0.0, part["height"]))
    gaps = [gap_to(part, x, z) for x, _, z in mesh.positions]
    assert np.abs(gaps).max() < 1e-9


def test_ropes_hang_one_above_another_and_end_at_a_post() -> None:
    part, mesh, corners = corners_of(SQUARE)
    inside = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    radius = float(part["radius"])
    assert inside == pytest.approx(math.pi * (ROPE_LEVELS * 4.0 * radius**2 + 1.3 * POST**2), rel=0.01)
    assert mesh.positions[:, 1].max() == pytest.approx(1.3)
    assert max(gap_to(part, x, z) for x, _, z in mesh.positions) < POST
