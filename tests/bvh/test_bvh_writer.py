"""Writing BVH: numbers as text, round trips, chunks, and files that appear whole or not at all."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from bvh_text import PLAIN, bvh, same
from hypothesis import example, given, settings
from hypothesis import strategies as st
from naive_bvh import rotation_order

from crowdsim.bvh.io import (
    BvhWriter,
    format_bvh,
    format_header,
    format_motion,
    from_clip,
    parse_bvh,
    read_bvh,
    to_clip,
    write_bvh,
)
from crowdsim.errors import BvhError, OutputError
from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.skeleton import Clip, Skeleton

ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]


def as_python_writes(motion, decimals):
    rows = [" ".join(f"{value:.{decimals}f}" for value in row) for row in motion]
    text = "\n".join(rows) + "\n" if len(rows) else ""
    zero = f"{0:.{decimals}f}"
    return " ".join(zero if word == f"-{zero}" else word for word in text.replace("\n", " \n ").split(" ")).replace(
        " \n ", "\n"
    )


def walking_clip(frames=40, seed=0, moving=False, spin=0.3):
    """Joints that turn smoothly and far, a chain of four with two end sites."""
    rng = np.random.default_rng(seed)
    offsets = rng.normal(size=(4, 3))
    skeleton = Skeleton(
        ("Hips", "a b", "mixamorig:c", "End"),
        np.array([-1, 0, 1, 1], np.int32),
        offsets,
        np.array([2, 3, 3], np.int32),
        rng.normal(size=(3, 3)),
    )
    steps = quaternion.from_rotation_vector(rng.normal(size=(4, 3)) * spin)
    rotations = np.empty((frames, 4, 4))
    rotations[0] = quaternion.normalise(rng.normal(size=(4, 4)))
    for frame in range(1, frames):
        rotations[frame] = quaternion.multiply(rotations[frame - 1], steps)
    roots = np.cumsum(rng.normal(size=(frames, 3)), axis=0) * 0.01
    translations = None
    if moving:
        translations = offsets + 0.1 * rng.normal(size=(frames, 4, 3))
        translations[:, 0] = roots
    return Clip("walk", skeleton, 60.0, roots, rotations, translations)


def angle_between(a, b):
    """Angles [deg] between rotations."""
    return np.degrees(
        np.linalg.norm(quaternion.to_rotation_vector(quaternion.multiply(quaternion.conjugate(a), b)), axis=-1)
    )


@settings(max_examples=300, deadline=None)
@given(
    st.lists(
        st.one_of(
            st.floats(-1000, 1000),
            st.floats(-1e9, 1e9),
            st.floats(-1e-5, 1e-5),
            st.floats(allow_nan=False, allow_infinity=False),
            st.integers(-(10**9), 10**9).map(lambda n: n / 2**7),
            st.integers(-(10**6), 10**6).map(lambda n: n * 5e-7),
        ),
        min_size=1,
        max_size=12,
    ),
    st.integers(0, 12),
)
@example([0.5, 1.5, 2.5, -0.5, -0.4, 999.5, 9999.5, 0.0, -0.0], 0)
@example([1.005, 2.675, 0.125, 0.375, 999.995, 999.9949999, 9.995], 2)
@example([999.9999995, 999.9999994, 99999.9999995, -1e-7, -5e-7, 4503599627.3, 4503599628.0], 6)
@example([1e300, -1e22, 3.0], 6)
@example([0.1, 1 / 3, 123.456789012345], 12)
def test_numbers_are_written_as_correct_rounding_asks(values, decimals):
    motion = np.array(values).reshape(1, -1)
    assert format_motion(motion, decimals).decode() == as_python_writes(motion, decimals)


def test_rows_are_lines():
    motion = np.arange(12.0).reshape(4, 3) - 5
    assert format_motion(motion, 1) == b"-5.0 -4.0 -3.0\n-2.0 -1.0 0.0\n1.0 2.0 3.0\n4.0 5.0 6.0\n"
    assert format_motion(motion[:0]) == b""
    assert format_motion(motion[::2, ::-1], 0) == b"-3 -4 -5\n3 2 1\n"
    assert format_motion(motion.astype(np.float32), 0) == format_motion(motion, 0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_are_refused_with_their_position(value):
    motion = np.zeros((3, 15))
    motion[2, 7] = value
    with pytest.raises(BvhError) as caught:
        format_motion(motion)
    assert str(caught.value) == f"frame 2, column 7 is {value}, which no BVH file can hold"
    broken = bvh(PLAIN, **{" 50 60 7": f" {value} 60 7"})
    with pytest.raises(BvhError) as caught:
        format_bvh(broken)
    assert str(caught.value) == f"frame 0, joint 'Chest', channel Xrotation is {value}, which no BVH file can hold"


def test_decimals_out_of_range_are_refused():
    for decimals in (-1, 13):
        with pytest.raises(BvhError, match=f"{decimals} decimals cannot be written, expected 0 to 12"):
            format_motion(np.zeros((1, 1)), decimals)


def test_a_file_read_written_and_read_holds_the_same():
    walk = bvh(PLAIN)
    same(parse_bvh(format_bvh(walk)), walk)
    assert b"Frame Time: 0.0083333333\n" in format_bvh(walk)
    two = PLAIN[: PLAIN.index("MOTION")] + PLAIN[PLAIN.index("ROOT") : PLAIN.index("MOTION")]
    with_two_roots = bvh(two)
    same(parse_bvh(format_bvh(with_two_roots)), with_two_roots)
    odd = bvh(PLAIN, **{"End Site": "End nub 1", "Chest": "a : b{1}ü", "OFFSET 0 10 0": "OFFSET 1e-7 123456.789 -0"})
    same(parse_bvh(format_bvh(odd)), odd)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("moving", [False, True])
def test_a_clip_written_and_read_is_the_same_to_a_ten_thousandth_of_a_degree(order, moving):
    clip = walking_clip(moving=moving)
    written = from_clip(clip, order)
    back = parse_bvh(format_bvh(written))
    assert back.fps == 60.0
    assert back.names == clip.skeleton.names
    np.testing.assert_allclose(back.motion, written.motion, atol=1e-6)
    again = to_clip(back, 0.01)
    assert angle_between(clip.rotations, again.rotations).max() < 1e-5
    np.testing.assert_allclose(again.root_positions, clip.root_positions, atol=1e-7)
    np.testing.assert_allclose(again.skeleton.offsets, clip.skeleton.offsets, atol=1e-10)
    np.testing.assert_allclose(again.skeleton.end_offsets, clip.skeleton.end_offsets, atol=1e-10)
    for ours, theirs in zip(clip_kinematics(clip), clip_kinematics(again), strict=True):
        np.testing.assert_allclose(np.abs(ours), np.abs(theirs), atol=1e-6)


@pytest.mark.parametrize("order", ORDERS)
def test_orientation_survives_at_gimbal_lock(order):
    rng = np.random.default_rng(3)
    angles = rng.uniform(-180, 180, (200, 1, 3))
    angles[:, 0, 1] = np.where(np.arange(200) % 2, 90.0, -90.0) + rng.choice([0.0, 1e-9, 1e-5, 1e-3, -1e-4], 200)
    clip = walking_clip(200)
    rotations = np.repeat(quaternion.from_euler(np.radians(angles), order), 4, axis=1)
    clip = Clip("lock", clip.skeleton, 30.0, clip.root_positions, rotations)
    again = to_clip(parse_bvh(format_bvh(from_clip(clip, order))))
    assert angle_between(rotations, again.rotations).max() < 2e-5


def test_every_joint_may_have_an_order_of_its_own():
    clip = walking_clip()
    orders = ("ZXY", "XYZ", "YZX", "ZYX")
    written = from_clip(clip, orders)
    assert tuple(map(rotation_order, written.channels)) == orders
    again = to_clip(parse_bvh(format_bvh(written)), 0.01)
    assert angle_between(clip.rotations, again.rotations).max() < 1e-5


@pytest.mark.parametrize("order", ORDERS)
def test_angles_are_continuous_over_several_revolutions(order):
    frames = np.arange(720)
    clip = walking_clip(720)
    rotations = clip.rotations.copy()
    for joint in range(3):
        angles = np.zeros((720, 3))
        angles[:, joint] = np.radians(frames * 2.0)
        rotations[:, joint] = quaternion.from_euler(angles, order)
    motion = from_clip(Clip("spin", clip.skeleton, 60.0, clip.root_positions, rotations), order).motion
    np.testing.assert_allclose(
        np.diff(motion[:, 3:12], axis=0), np.diff(motion[:, 3:12], axis=0)[:1].repeat(719, 0), atol=1e-6
    )
    assert motion[-1, 3] == pytest.approx(1438.0)


def test_each_triple_is_the_nearest_of_all_that_mean_the_same():
    motion = from_clip(walking_clip(400, seed=5, spin=0.1), "ZXY").motion[:, 3:6]
    for before, now in itertools.pairwise(motion):
        best = min(
            np.abs(turned + 360.0 * np.round((before - turned) / 360.0) - before).sum()
            for turned in (now, np.array([now[0] + 180, 180 - now[1], now[2] + 180]))
        )
        assert np.abs(now - before).sum() <= best + 1e-9


def test_the_first_frame_has_the_usual_angles():
    angles = np.array([[170.0, -80.0, -170.0]])
    rotations = np.repeat(quaternion.from_euler(np.radians(angles), "ZXY")[:, None], 4, axis=1)
    motion = from_clip(Clip("a", walking_clip(1).skeleton, 60.0, np.zeros((1, 3)), -rotations), "ZXY").motion
    np.testing.assert_allclose(motion[0, 3:6], angles[0], atol=1e-9)


@pytest.mark.parametrize("moving", [False, True])
def test_a_file_written_in_chunks_is_the_file_written_at_once(tmp_path, moving):
    clip = walking_clip(50, seed=2, moving=moving)
    write_bvh(tmp_path / "whole.bvh", clip, order="XYZ", decimals=5)
    with BvhWriter(tmp_path / "parts.bvh", clip.skeleton, 60.0, 50, order="XYZ", decimals=5, moving=moving) as writer:
        for start, stop in itertools.pairwise((0, 1, 1, 20, 50)):
            part = clip.sliced(start, stop)
            assert not (tmp_path / "parts.bvh").exists()
            writer.append(part.root_positions, part.rotations, part.translations)
    assert (tmp_path / "parts.bvh").read_bytes() == (tmp_path / "whole.bvh").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["parts.bvh", "whole.bvh"]


def test_a_file_that_is_not_finished_leaves_no_trace(tmp_path):
    clip = walking_clip(5)
    (tmp_path / "a.bvh").write_text("old")
    with (
        pytest.raises(BvhError, match="4 frames, 5 were announced"),
        BvhWriter(tmp_path / "a.bvh", clip.skeleton, 60.0, 5) as writer,
    ):
        writer.append(clip.root_positions[:4], clip.rotations[:4])
    with (
        pytest.raises(BvhError, match="5 frames, 4 were announced"),
        BvhWriter(tmp_path / "a.bvh", clip.skeleton, 60.0, 4) as writer,
    ):
        writer.append(clip.root_positions, clip.rotations)
    with pytest.raises(KeyboardInterrupt), BvhWriter(tmp_path / "a.bvh", clip.skeleton, 60.0, 4):
        raise KeyboardInterrupt
    clip.rotations[3, 2, 1] = np.nan
    with pytest.raises(BvhError, match="frame 3, joint 'mixamorig:c', channel Zrotation is nan"):
        write_bvh(tmp_path / "a.bvh", clip)
    assert [path.name for path in tmp_path.iterdir()] == ["a.bvh"]
    assert (tmp_path / "a.bvh").read_text() == "old"


def test_an_existing_file_is_replaced_whole(tmp_path):
    (tmp_path / "a.bvh").write_text("old" * 1_000_000)
    write_bvh(tmp_path / "a.bvh", bvh(PLAIN))
    same(read_bvh(tmp_path / "a.bvh"), bvh(PLAIN))


def test_a_file_that_cannot_be_written_is_an_output_error(tmp_path):
    with pytest.raises(OutputError, match=r"nowhere/a\.bvh: cannot be written: No such file"):
        write_bvh(tmp_path / "nowhere" / "a.bvh", bvh(PLAIN))
    (tmp_path / "folder.bvh").mkdir()
    with pytest.raises(OutputError, match=r"folder\.bvh: cannot be written"):
        write_bvh(tmp_path / "folder.bvh", bvh(PLAIN))
    assert [path.name for path in tmp_path.iterdir()] == ["folder.bvh"]


def test_what_no_file_can_hold_is_refused():
    clip = walking_clip(3)
    for name in ("", " a", "a ", "a\nb", "a\rb", "a {b", "\udcff"):
        skeleton = Skeleton((name, *clip.skeleton.names[1:]), clip.skeleton.parents, clip.skeleton.offsets)
        with pytest.raises(BvhError, match=r"joint name .* cannot be written"):
            format_header(from_clip(Clip("a", skeleton, 60.0, clip.root_positions, clip.rotations)))
    for order in ("ZXZ", "zxy", "XY", ""):
        with pytest.raises(BvhError, match="expected one of XYZ, XZY, YXZ, YZX, ZXY, ZYX"):
            from_clip(clip, order)
    with pytest.raises(BvhError, match="2 rotation orders for 4 joints"):
        from_clip(clip, ("XYZ", "ZYX"))
    with pytest.raises(BvhError, match="unit scale"):
        from_clip(clip, unit_scale=0.0)


def test_a_deep_tree_is_written_in_room_that_grows_with_its_joints():
    depth = 1000
    parents = np.arange(-1, depth - 1, dtype=np.int32)
    skeleton = Skeleton(tuple(map(str, range(depth))), parents, np.zeros((depth, 3)))
    text = format_header(from_clip(Clip("deep", skeleton, 60.0, np.zeros((0, 3)), np.zeros((0, depth, 4)))))
    assert len(text) < 1000 * depth
    np.testing.assert_array_equal(parse_bvh(text).parents, parents)


def test_other_readers_find_the_same_positions(tmp_path):
    import bvhio
    import pybvh

    clip = walking_clip(12, seed=4)
    positions, _ = clip_kinematics(clip)
    write_bvh(tmp_path / "a.bvh", clip, order=("XYZ", "ZXY", "YZX", "ZYX"))
    other = pybvh.read_bvh_file(str(tmp_path / "a.bvh"))
    np.testing.assert_allclose(other.joint_positions() / 100, positions, atol=1e-6)
    tree = bvhio.readAsHierarchy(str(tmp_path / "a.bvh"))
    for frame in range(12):
        tree.loadPose(frame)
        for joint, _, _ in tree.layout():
            if joint.Name in clip.skeleton.names:
                place = positions[frame, clip.skeleton.names.index(joint.Name)]
                np.testing.assert_allclose(np.array(list(joint.PositionWorld)) / 100, place, atol=1e-4)


@pytest.mark.mocap
def test_real_capture_keeps_its_channels_in_its_own_rotation_orders(mocap):
    walk = read_bvh(mocap / "fight_daz" / "cmu_135_04_front_kick.bvh")
    orders = list(map(rotation_order, walk.channels))
    assert set(orders) == {"ZYX", "ZXY"}
    back = parse_bvh(format_bvh(from_clip(to_clip(walk, 0.01), orders)))
    assert back.channels == walk.channels
    np.testing.assert_allclose(back.motion[:, :3], walk.motion[:, :3], atol=1e-6)
    angles, before = back.motion.reshape(-1, 44, 3)[:, 1:], walk.motion.reshape(-1, 44, 3)[:, 1:]
    other = np.stack([before[..., 0] + 180, 180 - before[..., 1], before[..., 2] + 180], axis=-1)
    gaps = [np.abs((angles - same_turn + 180) % 360 - 180).max(axis=-1) for same_turn in (before, other)]
    assert np.minimum(*gaps).max() < 1e-4


@pytest.mark.mocap
@pytest.mark.parametrize("order", ORDERS)
def test_real_capture_survives_a_round_trip(mocap, tmp_path, order):
    walk = read_bvh(mocap / "fight_daz" / "cmu_135_07_mawashigeri.bvh")
    same_again = parse_bvh(format_bvh(walk))
    np.testing.assert_allclose(same_again.motion, walk.motion, atol=1e-6)
    np.testing.assert_array_equal(same_again.offsets, walk.offsets)
    clip = to_clip(walk, 0.01)
    write_bvh(tmp_path / "a.bvh", clip, order)
    again = to_clip(read_bvh(tmp_path / "a.bvh"), 0.01)
    assert angle_between(clip.rotations, again.rotations).max() < 1e-5
    np.testing.assert_allclose(again.root_positions, clip.root_positions, atol=1e-7)


def test_joints_that_are_not_depth_first_are_written_as_they_hang_together():
    """Brothers before nephews: a file holds them in reverse order, and its columns with them."""
    generator = np.random.default_rng(8)
    skeleton = Skeleton(
        names=("root", "left", "right", "left_end", "right_end"),
        parents=np.array([-1, 0, 0, 1, 2], np.int32),
        offsets=generator.normal(size=(5, 3)),
        end_parents=np.array([4, 3], np.int32),
        end_offsets=generator.normal(size=(2, 3)),
    )
    rotations = quaternion.normalise(generator.normal(size=(6, 5, 4)))
    clip = Clip("broad", skeleton, 60.0, generator.normal(size=(6, 3)), rotations)
    back = to_clip(parse_bvh(format_bvh(from_clip(clip))), 0.01)
    assert back.skeleton.names == ("root", "left", "left_end", "right", "right_end")
    expected, _ = clip_kinematics(clip)
    found, _ = clip_kinematics(back)
    positions = [back.skeleton.names.index(name) for name in skeleton.names]
    np.testing.assert_allclose(found[:, positions], expected, atol=1e-6)
    bvh = from_clip(clip)
    with pytest.raises(BvhError, match="joints are out of order"):
        format_bvh(replace(bvh, parents=skeleton.parents, names=skeleton.names))


def test_a_writer_in_chunks_orders_joints_too(tmp_path):
    generator = np.random.default_rng(9)
    skeleton = Skeleton(("a", "b", "c", "d"), np.array([-1, 0, 0, 1], np.int32), generator.normal(size=(4, 3)))
    clip = Clip(
        "x", skeleton, 30.0, generator.normal(size=(5, 3)), quaternion.normalise(generator.normal(size=(5, 4, 4)))
    )
    with BvhWriter(tmp_path / "x.bvh", skeleton, 30.0, 5) as writer:
        writer.append(clip.root_positions[:2], clip.rotations[:2])
        writer.append(clip.root_positions[2:], clip.rotations[2:])
    assert (tmp_path / "x.bvh").read_bytes() == format_bvh(from_clip(clip))
