"""Mutated BVH is read, with what is odd about it, or refused with its line; nothing else happens.

Hypothesis draws seeds of batches: a mutation costs less than drawing an example.
"""

import random
import re
import sys
from pathlib import Path

import pytest
from bvh_text import PLAIN
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))
from mutating import Guard, check_batch, mutate

from crowdsim.bvh.io import parse_bvh, to_clip
from crowdsim.capture.loading import load_capture
from crowdsim.errors import BvhError

BATCH = 100
SMALL = b"""\
HIERARCHY
ROOT a
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT b
  {
    OFFSET 0 1 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 1 0
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.05
0 9 0 1 2 3 4 5 6
0 9 1 1 2 3 4 5 6
0 9 2 1 2 3 4 5 6
"""
SEEDS = (SMALL, PLAIN.encode())
_PLACED = re.compile(r"mutated\.bvh:[1-9]\d*:[1-9]\d*: \S[^\n]*")


def make(rng: random.Random) -> bytes:
    text = mutate(rng, SEEDS[rng.random() < 0.2], rng.choice(SEEDS))
    return text.decode("latin-1").encode("utf-16") if rng.random() < 0.01 else text


def read(text: bytes) -> None:
    refusal: object = ""
    try:
        bvh = parse_bvh(text, "mutated.bvh")
    except BvhError as error:
        refusal = error
    if refusal:
        assert _PLACED.fullmatch(str(refusal)), refusal
        return
    assert all(map(_PLACED.fullmatch, bvh.findings)), bvh.findings
    assert set(bvh.faults) <= set(bvh.findings)
    assert bvh.motion.shape == (bvh.frame_count, bvh.channel_count)
    assert bvh.fps > 0.0
    clip = to_clip(bvh)
    assert clip.rotations.shape == (bvh.frame_count, clip.skeleton.joint_count, 4)


@pytest.fixture(scope="module")
def guard(tmp_path_factory: pytest.TempPathFactory) -> Guard:
    """A guard; what is read is without a fault unless mutated, and reading it has loaded all that it needs."""
    for seed in SEEDS:
        read(seed)
        read(seed.decode().encode("utf-16"))
        assert parse_bvh(seed).faults == ()
    read(SMALL + b"nan 1 2\n")
    return Guard(tmp_path_factory.mktemp("root"))


several = settings(
    max_examples=10, deadline=None, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck)
)


@several
@given(seed=st.integers(0, 2**63))
def test_mutated_bvh_is_read_or_refused_with_its_line(guard: Guard, seed: int) -> None:
    check_batch(guard, seed, BATCH, make, read)


@pytest.mark.slow
@settings(several, max_examples=1000)
@given(seed=st.integers(0, 2**63))
def test_a_hundred_thousand_mutated_bvh_texts_are_read_or_refused(guard: Guard, seed: int) -> None:
    check_batch(guard, seed, BATCH, make, read)


@several
@given(seed=st.integers(0, 2**63))
def test_what_is_found_out_about_mutated_bvh_is_finite_or_a_fault(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "mutated.bvh"
    path.write_bytes(make(random.Random(seed)))
    try:
        capture = load_capture(path)
    except BvhError:
        return
    assert capture.finite or capture.bvh.faults
