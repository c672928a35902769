"""Rates from written frame times."""

import math

import pytest

from crowdsim.bvh.io import snap_rate


@pytest.mark.parametrize(
    ("text", "fps"),
    [
        ("0.00833333", 120),
        ("0.0083333", 120),
        ("0.008333", 120),
        ("0.0083", 120),
        ("0.0083333338", 120),
        ("8.33333e-3", 120),
        ("8.33333E-03", 120),
        ("0.033333", 30),
        ("0.0333333333333", 30),
        ("0.033333335071802", 30),
        ("0.03333", 30),
        ("0.0333", 30),
        ("0.033", 30),
        (".033333", 30),
        ("0.0333667", 30000 / 1001),
        ("0.03336667", 30000 / 1001),
        ("0.033367", 30000 / 1001),
        ("0.04167", 24),
        ("0.0416667", 24),
        ("0.041667", 24),
        ("0.0417083", 24000 / 1001),
        ("0.04170833", 24000 / 1001),
        ("0.016667", 60),
        ("0.01667", 60),
        ("0.0167", 60),
        ("0.016666", 60),
        ("0.0166833", 60000 / 1001),
        ("0.016683", 60000 / 1001),
        ("0.04", 25),
        ("0.02", 50),
        ("0.01", 100),
        ("0.005", 200),
        ("0.004167", 240),
        ("0.00416667", 240),
        ("0.0111111", 90),
        ("0.013889", 72),
        ("0.066667", 15),
        ("0.0666667", 15),
        ("0.1", 10),
        ("1", 1),
        ("1.0", 1),
        ("0.001", 1000),
        ("0.0009766", 1024),
        ("0.025641", 39),
    ],
)
def test_a_truncated_or_rounded_frame_time_is_the_rate_it_was_made_from(text, fps):
    assert snap_rate(text, float(text)) == pytest.approx(fps, rel=1e-12)


@pytest.mark.parametrize("decimals", [5, 6, 7, 8, 10, 12])
def test_every_common_rate_survives_being_written(decimals):
    for fps in (10, 12, 15, 20, 24, 25, 29, 30, 48, 50, 59, 60, 72, 75, 90, 100, 119, 120, 30000 / 1001, 24000 / 1001):
        rounded = f"{1 / fps:.{decimals}f}"
        truncated = f"{math.floor(10**decimals / fps) / 10**decimals:.{decimals}f}"
        assert snap_rate(rounded, float(rounded)) == pytest.approx(fps, rel=1e-12)
        if decimals > 5:
            assert snap_rate(truncated, float(truncated)) == pytest.approx(fps, rel=1e-12)


def test_a_frame_time_that_fits_no_rate_is_kept():
    assert snap_rate("0.0137931", 0.0137931) == pytest.approx(72.5, rel=1e-4)
    assert snap_rate("2.5", 2.5) == 0.4
