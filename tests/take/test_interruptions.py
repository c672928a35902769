"""An action that a blow interrupts ends where it is left, at a whole playback frame, with a short blend."""

from dataclasses import replace

import numpy as np
import pytest
from take.synthetic_take import actions, build_take, sampler

from crowdsim.poses.motion import prepare_motion
from crowdsim.poses.window import INTERRUPTED, Window


@pytest.mark.parametrize("into", [0.25, 0.5, 1.0])
def test_an_action_ends_where_it_is_interrupted(into: float) -> None:
    first, lengths = actions(2, longest=20, seed=3)
    lengths[:] = np.maximum(lengths, 8)
    take, policy = build_take([[0, 1]], first, lengths, 12)
    cut = 5
    action, done = np.array(take.action), np.array(take.action_frame)
    action[cut:, 0], done[cut:, 0] = 1, into + np.arange(12 - cut)
    whole, broken = (
        Window(one, prepare_motion(policy), np.arange(1), 0, 12)
        for one in (take, replace(take, action=action, action_frame=done))
    )
    stride, origin = whole.motion.frames.stride, int(whole.motion.origins[0])
    left = done[cut - 1, 0] + 1.0 - into
    assert broken.rows.lengths[cut - 1, 0] == pytest.approx(left)
    transitions = broken.transitions
    at = int(np.argmin(np.abs(transitions.times - (cut - into) / take.control_rate)))
    assert transitions.times[at] == pytest.approx((cut - into) / take.control_rate)
    assert transitions.before[at] == origin + round(left * stride)
    np.testing.assert_allclose(transitions.spans[at], INTERRUPTED)
    # Actions that end by themselves are as they were.
    assert (whole.rows.lengths == whole.motion.lengths[np.asarray(take.action)]).all()
    assert np.isfinite(
        sampler(replace(take, action=action, action_frame=done), policy).sample(0, 40, 60)[0].rotations
    ).all()
