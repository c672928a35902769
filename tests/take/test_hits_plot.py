"""Hits are drawn on a silhouette of the body: what is hit on the head is drawn on the head."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import crowdsim, write_scene

from crowdsim.poses.sampler import PoseSampler
from crowdsim.runs.opening import open_run
from crowdsim.take.hits_plot import build_silhouette, find_hits, hit_figure
from crowdsim.take.plots import action_figure, distance_figure


@pytest.fixture
def sampler(workplace: Path) -> PoseSampler:
    write_scene(workplace / "four.yaml", duration=600)
    assert crowdsim("run", "four.yaml", "--out", "run", "--quiet") == 0
    return open_run(workplace / "run").sampler


def surface_gaps(points, silhouette):
    """How far points are from head and torso of a silhouette, negative inside. Shape (2, n)."""
    axis = silhouette.pelvis - silhouette.neck
    share = np.clip((points - silhouette.neck) @ axis / (axis @ axis), 0.0, 1.0)[:, None]
    to_torso = np.linalg.norm(points - silhouette.neck - share * axis, axis=1) - silhouette.torso_radius
    return np.linalg.norm(points - silhouette.head, axis=1) - silhouette.head_radius, to_torso


def test_hits_lie_on_the_part_of_the_silhouette_that_they_hit(sampler: PoseSampler) -> None:
    silhouette = build_silhouette(sampler.policies[0].database)
    hits = find_hits(sampler, silhouette)
    assert hits.count == len(hits.points) == int(np.count_nonzero(sampler.take.events.landed)) > 3
    head, torso = surface_gaps(hits.points, silhouette)
    # In the motion of a small policy a few fists do not reach what they hit.
    assert np.quantile(np.abs(np.where(hits.on_head, head, torso)), 0.9) < 0.02
    assert set(hits.limbs.tolist()) <= {0, 1}


def test_the_silhouette_is_upright_on_the_floor(sampler: PoseSampler) -> None:
    silhouette = build_silhouette(sampler.policies[0].database)
    lowest = np.minimum(
        silhouette.starts[:, 1] - silhouette.radii[:, 0], silhouette.ends[:, 1] - silhouette.radii[:, 1]
    )
    assert abs(lowest.min()) < 0.1
    assert silhouette.head[1] > silhouette.neck[1] > silhouette.pelvis[1] > 0.6


def test_the_figure_has_metres_and_equal_scales_and_both_views(sampler: PoseSampler) -> None:
    figure = hit_figure(sampler)
    assert [axes.get_title() for axes in figure.axes] == ["from the front", "from its left side"]
    assert [axes.get_xlabel() for axes in figure.axes] == ["to its left [m]", "ahead of it [m]"]
    assert figure.axes[0].get_ylabel() == "height [m]"
    assert all(axes.get_aspect() == 1.0 and not axes.xaxis_inverted() for axes in figure.axes)
    # The outlines of limbs, then of torso and head.
    assert all(len(axes.patches) > 10 for axes in figure.axes)
    assert "strikes that landed on avatars" in figure.get_suptitle()
    others = [distance_figure(sampler.take).axes[0], action_figure(sampler.take).axes[0]]
    assert [axes.get_ylabel() for axes in others] == ["distance to the opponent [m]", "number of times used"]


def test_a_run_without_hits_is_drawn_too(sampler: PoseSampler) -> None:
    none = {name: np.asarray(getattr(sampler.take.events, name))[:0] for name in vars(sampler.take.events)}
    take = SimpleNamespace(**{**vars(sampler.take), "events": SimpleNamespace(**none)})
    take.frame_count, take.control_rate = sampler.take.frame_count, sampler.take.control_rate
    bare = SimpleNamespace(take=take, policies=sampler.policies, moments=sampler.moments)
    assert hit_figure(bare).get_suptitle() == "0 strikes that landed on avatars"
