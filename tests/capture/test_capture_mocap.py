"""Real capture, as it is and written again in the conventions of other exporters."""

from __future__ import annotations

import numpy as np
import pytest
from conventions import CONVENTIONS
from exporters import UPS, Export, export_motion

from crowdsim.bvh.io import write_bvh
from crowdsim.capture.loading import load_capture
from crowdsim.capture.report import describe_capture
from crowdsim.motion.contacts import runs

pytestmark = pytest.mark.mocap

FILES = {
    "fight_daz/cmu_13_18_boxing.bvh": 18,
    "fight_daz/cmu_135_09_oiduki.bvh": 8,
    "fight_daz/cmu_02_05_punch_strike.bvh": 8,
    "locomotion_daz/cmu_07_01.bvh": 0,
}


def _told(path):
    capture = load_capture(path)
    return capture, describe_capture(capture)


@pytest.mark.parametrize("name", FILES)
def test_strikes_unit_axis_and_lead_in_of_real_capture(mocap, name):
    capture, result = _told(mocap / name)
    assert result["strikes"] == FILES[name]
    assert (result["unit_scale"], result["up_axis"], result["joints"], result["fps"]) == (0.01, "y", 43, 120.0)
    assert result["height_m"] == pytest.approx(1.684, abs=0.005)
    assert 5 <= result["lead_in_frames"] <= 12
    # One file has its forearms turned the wrong way.
    assert len(result["findings"]) == (1 if "13_18" in name else 0)
    assert capture.faults == ()


@pytest.mark.parametrize("name", FILES)
def test_the_same_is_found_in_the_conventions_of_other_exporters(mocap, tmp_path, name):
    capture, result = _told(mocap / name)
    draw = np.random.default_rng(sorted(FILES).index(name))
    for how in draw.choice(np.array(CONVENTIONS, dtype=object), 9, replace=False):
        axis = str(draw.choice(list(UPS)))
        export = Export(
            scale=float(draw.choice([1.0, 0.01, 0.0254, 0.0254 / 0.45])),
            up=UPS[axis],
            turn_rest=bool(draw.random() < 0.6),
            heading=float(draw.uniform(-3.0, 3.0)),
            rest=str(draw.choice(["T", "A", "I", "bones"])),
            order=str(draw.choice(["ZXY", "XYZ", "mixed"])),
            six=bool(draw.random() < 0.3),
            every=int(draw.choice([1, 2, 4])),
        )
        path = tmp_path / f"{how.name}.bvh"
        write_bvh(path, export_motion(capture.clip, capture.roles, how, export))
        _, found = _told(path)
        which = f"{how.name}, {export}"
        assert {role: found["roles"][role] for role in how.roles} == how.roles, which
        assert found["unit_scale"] == pytest.approx(export.scale), which
        assert found["up_axis"] == axis, which
        # Two short swings of one clip lie on the border of what is a strike.
        assert abs(found["strikes"] - result["strikes"]) <= (2 if "13_18" in name else 0), which
        assert abs(found["contacts"] - result["contacts"]) <= 1 + 0.15 * result["contacts"], which
        assert found["findings"] == [], which


def test_a_boxer_who_bounces_is_never_long_in_the_air(mocap):
    analysis = load_capture(mocap / "fight_daz/cmu_13_18_boxing.bvh").analysis
    airborne = runs(~analysis.contacts.any(axis=1))
    assert (airborne[:, 1] - airborne[:, 0]).max() / 60.0 < 0.5
    assert 0.5 < analysis.contacts.mean() < 0.75


@pytest.mark.parametrize("name", ["cmu_07_01", "cmu_08_01", "cmu_12_02"])
def test_someone_who_walks_has_a_foot_on_the_ground(mocap, name):
    analysis = load_capture(mocap / f"locomotion_daz/{name}.bvh").analysis
    assert analysis.contacts.any(axis=1).mean() > 0.9
    assert 0.4 < analysis.contacts.mean() < 0.75


def test_someone_who_runs_is_in_the_air_between_steps(mocap):
    analysis = load_capture(mocap / "locomotion_daz/cmu_09_01.bvh").analysis
    assert 0.1 < analysis.contacts.any(axis=1).mean() < 0.8
    assert not analysis.contacts.all(axis=1).any()
