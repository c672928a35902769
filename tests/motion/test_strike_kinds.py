"""The kind of a strike, held against what the embedded boxer truly throws, and against its mirror image."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from crowdsim.motion.database import build_database
from crowdsim.motion.measuring import measure_clips
from crowdsim.motion.strike_kinds import HEIGHTS, KINDS, strike_heights, strike_kinds
from crowdsim.performer.session import perform

TRUE_KINDS = {"jab": "straight", "straight": "straight"}


@pytest.fixture(scope="module")
def session():
    performances = perform(150.0, 21)
    return performances, build_database(measure_clips([one.clip for one in performances]), mirror=True)


def true_kinds(performances, database):
    """The true kind of each strike of the clips themselves, by hand and frame; None where there is none near."""
    starts = database.clip_starts * database.stride
    true = [
        (starts[clip] + strike.frame, strike.hand, TRUE_KINDS.get(strike.kind, strike.kind.split("_")[-1]))
        for clip, performance in enumerate(performances)
        for strike in performance.truth.strikes
    ]
    found = []
    for frame, hand in zip(database.strike_frames, database.strike_limbs, strict=True):
        near = min((abs(int(other - frame)), kind) for other, one, kind in true if one == hand)
        found.append(near[1] if near[0] <= 4 else None)
    return found


def test_strike_kinds_match_those_that_the_performer_threw(session):
    performances, database = session
    kinds = [KINDS[kind] for kind in strike_kinds(database)]
    pairs = [pair for pair in zip(true_kinds(performances, database), kinds, strict=True) if pair[0]]
    totals, right = Counter(true for true, _ in pairs), Counter(true for true, kind in pairs if true == kind)
    shares = {kind: right[kind] / totals[kind] for kind in totals}
    assert set(shares) >= {"straight", "hook", "uppercut"}
    assert shares["straight"] > 0.9
    assert min(shares.values()) > 0.6
    assert sum(right.values()) / len(pairs) > 0.8


def test_mirror_images_have_the_kinds_and_heights_of_their_originals(session):
    _, database = session
    half = len(database.strike_frames) // 2
    for result in (strike_kinds(database), strike_heights(database)):
        assert np.mean(result[:half] == result[half:]) > 0.98
        assert len(np.unique(result)) > 1


def test_strikes_from_the_necks_height_on_go_to_the_head():
    positions, necks = np.array([[0.0, 1.5, 0.6], [0.1, 1.2, 0.5], [0.0, 1.3, 0.5]]), np.array([[0.0, 1.4, 0.0]] * 9)
    necks[6, 1] = 1.25
    motion = SimpleNamespace(strike_frames=np.array([2, 4, 6]), strike_positions=positions, necks=necks)
    assert [HEIGHTS[height] for height in strike_heights(motion)] == ["head", "body", "head"]
