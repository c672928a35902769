"""Poses survive being packed, as finely as is promised, whatever they are."""

import zlib

import numpy as np
import pytest
from naive_view import unpack_block, unpack_scene

from crowdsim.view.blocks import COARSEST, FINEST, STEP, pack_block, pack_tables, rotation_bits

BITS = np.array([14, 13, 11, 9])


def smooth(rng, frames: int, count: int, joints: int) -> np.ndarray:
    """Rotations that go through all signs."""
    phases = rng.uniform(0, 6, (1, count, joints, 4))
    waves = np.sin(phases + rng.uniform(0.2, 3, (1, count, joints, 4)) * np.linspace(0, 6, frames)[:, None, None, None])
    return waves / np.linalg.norm(waves, axis=-1, keepdims=True)


def angle(one, other) -> np.ndarray:
    return 2 * np.arccos(np.minimum(np.abs((one * other).sum(axis=-1)), 1.0))


@pytest.mark.parametrize("frames", [1, 2, 37])
@pytest.mark.parametrize("seed", range(3))
def test_a_packed_block_gives_its_poses_again(frames: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotations = smooth(rng, frames, 3, 4)
    moves = rng.normal(0, 300, (frames, 3, 2, 3))
    ((places, found),) = unpack_block(pack_block([(BITS, moves, rotations)]), [BITS.tolist()], [2], [3], frames, STEP)
    assert np.abs(places - moves).max() <= 0.5 * STEP + 1e-9
    # A component that is left out is at least 0.2, so that it is off by up to five steps for the others' half steps.
    steps = 1.0 / (2.0 ** (BITS - 1) - 1)
    assert (angle(found, rotations).max(axis=(0, 1)) < 12 * steps).all()


def test_a_component_is_left_out_only_where_it_keeps_its_sign_and_is_not_small() -> None:
    still = np.tile([0.1, -0.99, 0.05, 0.05], (5, 1, 1, 1))
    turning = np.stack([np.cos(np.linspace(0, 6, 5)), np.sin(np.linspace(0, 6, 5)), *np.zeros((2, 5))], axis=-1)
    rotations = np.concatenate([still / np.linalg.norm(still, axis=-1, keepdims=True), turning[:, None, None]], axis=2)
    data = zlib.decompress(pack_block([(BITS[:2], np.zeros((5, 1, 1, 3)), rotations)]))
    assert list(data[:2]) == [1, 4]


def test_an_avatar_that_is_absent_is_where_it_was_last_or_will_be_first() -> None:
    rng = np.random.default_rng(1)
    rotations, moves = smooth(rng, 9, 3, 4), rng.normal(0, 2, (9, 3, 1, 3))
    for part in (rotations, moves):
        part[:4, 0], part[6:, 0], part[:, 2] = np.nan, np.nan, np.nan
    before = rotations.copy()
    ((places, found),) = unpack_block(pack_block([(BITS, moves, rotations)]), [BITS.tolist()], [1], [3], 9, STEP)
    np.testing.assert_array_equal(rotations, before)
    assert np.abs(places[:4, 0] - moves[4, 0]).max() < STEP
    assert np.abs(places[6:, 0] - moves[5, 0]).max() < STEP
    assert np.abs(places[:, 1] - moves[:, 1]).max() < STEP
    assert np.abs(places[:, 2]).max() == 0
    np.testing.assert_allclose(found[:, 2, :, 0], 1, atol=1e-3)


def test_joints_far_beyond_which_a_body_reaches_have_more_bits() -> None:
    bits = rotation_bits(np.array([1e-9, 0.1, 0.5, 1.0, 50.0]))
    assert (np.diff(bits) >= 0).all()
    assert bits[0] == COARSEST
    assert bits[-1] == FINEST


def test_tables_come_back_with_their_types() -> None:
    tables = {
        "floats": np.array([1.5, np.nan], np.float64),
        "bytes": np.arange(5, dtype=np.uint8),
        "flags": np.array([True, False]),
        "numbers": np.array([[-7, 8]], np.int64),
    }
    scene = unpack_scene(pack_tables({"name": "ä</script>"}, tables))
    assert scene["name"] == "ä</script>"
    for name, table in tables.items():
        np.testing.assert_array_equal(scene["tables"][name], table.ravel())
    assert scene["tables"]["floats"].dtype == np.float32


def test_a_table_of_another_kind_is_refused() -> None:
    with pytest.raises(KeyError):
        pack_tables({}, {"words": np.array(["a"])})
