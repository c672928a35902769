"""A folder of capture from several sources trains one policy, on one skeleton; people of a file are clips."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from conventions import CONVENTIONS
from exporters import Export, export_motion
from people import placed, together

from crowdsim.bvh.io import write_bvh
from crowdsim.capture.loading import load_capture
from crowdsim.errors import MotionError
from crowdsim.motion.roles import find_roles
from crowdsim.performer.session import perform
from crowdsim.training.fingerprint import capture_files
from crowdsim.training.motion_loading import load_motion
from crowdsim.training.recipe import Recipe


def recipe(folder: Path, *clips: str) -> Recipe:
    return Recipe.model_validate(
        {
            "version": 1,
            "motion": {"capture": {"folder": str(folder), "clips": list(clips)}, "mirror": False},
            "behaviours": {
                "approach": {
                    "axes": {"distance": {"count": 4, "maximum": 4}},
                    "rewards": [{"kind": "proximity", "distance": 1}],
                }
            },
        }
    )


@pytest.fixture(scope="module")
def mixed(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("mixed")
    performed = [performance.clip for performance in perform(24.0, 3)]
    clip = performed[0]
    roles = find_roles(clip.skeleton)
    how = {one.name: one for one in CONVENTIONS}
    write_bvh(folder / "long.bvh", export_motion(clip, roles, how["mixamo"], Export()))
    short = clip.sliced(0, 300)
    write_bvh(folder / "other.bvh", export_motion(short, roles, how["xsens"], Export(size=1.08, rest="I", scale=1.0)))
    write_bvh(folder / "pair.bvh", together([short, placed(short, 0.0, 1.1, np.pi)], ["Red:", "Blue:"]))
    return folder


def test_clips_of_all_sources_have_one_skeleton_and_their_strikes(mixed):
    wanted = recipe(mixed, "*.bvh")
    changes: dict[str, str] = {}
    database = load_motion(wanted, capture_files(wanted), changes=changes)
    assert database.clip_names == ("long", "other", "pair#1", "pair#2")
    assert "LeftUpLeg" in " ".join(database.skeleton.names)
    assert sorted(changes) == ["other", "pair#1", "pair#2"]
    assert changes["other"].startswith("0.926 times as large")
    starts = database.clip_starts * database.stride
    limbs = [
        database.strike_limbs[(database.strike_frames >= low) & (database.strike_frames < high)].tolist()
        for low, high in itertools.pairwise(starts)
    ]
    source = load_capture(mixed / "other.bvh").analysis.strikes
    assert limbs[1] == source.limbs[source.limbs < 2].tolist()
    assert limbs[2] == limbs[3] == limbs[0][: len(limbs[2])]
    assert len(limbs[1]) > 5


def test_one_person_of_a_file_may_be_asked_for(mixed):
    wanted = recipe(mixed, "pair.bvh#2")
    database = load_motion(wanted, capture_files(wanted))
    assert database.clip_names == ("pair#2",)
    assert database.skeleton.names[0] == "Blue:Hips"


def test_a_clip_that_is_no_other_person_is_refused_with_its_bones(mixed, tmp_path):
    for name in ("long.bvh", "other.bvh"):
        (tmp_path / name).write_bytes((mixed / name).read_bytes())
    text = (tmp_path / "other.bvh").read_text()
    assert text.count("OFFSET 0 -0.4428 0\n") == 2
    (tmp_path / "other.bvh").write_text(text.replace("OFFSET 0 -0.4428 0\n", "OFFSET 0 -0.84 0\n"))
    wanted = recipe(tmp_path, "*.bvh")
    with pytest.raises(MotionError, match=r"'other' is unlike 'long': shank \(LeftKnee to LeftAnkle\) of 84\.0 cm"):
        load_motion(wanted, capture_files(wanted))
