"""The detectors of contacts and strikes, held against what the embedded boxer truly does."""

from __future__ import annotations

import numpy as np
import pytest

from crowdsim.motion.body import build_body
from crowdsim.motion.contacts import find_contacts
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.strikes import find_strikes
from crowdsim.motion.tracks import build_tracks
from crowdsim.performer.session import perform

CONTROL_FRAME = 4
"""Playback frames in a control frame."""


@pytest.fixture(scope="module")
def session():
    performances = perform(150.0, 21)
    body = build_body(performances[0].clip.skeleton)
    return [(p, body, build_tracks(body, *clip_kinematics(p.clip))) for p in performances]


def test_contacts_are_found(session):
    right = wrong = missed = 0
    for performance, body, tracks in session:
        found, true = find_contacts(tracks, body.height, 60.0), performance.truth.contacts
        right += int((found & true).sum())
        wrong += int((found & ~true).sum())
        missed += int((~found & true).sum())
    assert 2 * right / (2 * right + wrong + missed) > 0.97


def test_strikes_are_found_within_a_control_frame(session):
    right = found_count = true_count = 0
    gaps = []
    for performance, body, tracks in session:
        found = find_strikes(tracks, body.height, 60.0)
        found_count += len(found.frames)
        true_count += len(performance.truth.strikes)
        free = set(range(len(found.frames)))
        for strike in performance.truth.strikes:
            near = [(abs(int(found.frames[k]) - strike.frame), k) for k in free if found.limbs[k] == strike.hand]
            if near and min(near)[0] <= CONTROL_FRAME:
                _, k = min(near)
                free.remove(k)
                right += 1
                gaps.append(found.speeds[k] / strike.speed)
    assert right / found_count > 0.95
    assert right / true_count > 0.95
    assert np.median(gaps) == pytest.approx(1.0, abs=0.08)
