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
    """How far points are outside of the capsules of a silhouette, negative inside. Shape (n,)."""
    axes = silhouette.ends - silhouette.starts
    ways = points[:, None] - silhouette.starts
    shares = np.clip(np.sum(ways * axes, axis=2) / np.maximum(np.sum(axes * axes, axis=1), 1e-12), 0.0, 1.0)
    radii = silhouette.radii[:, 0] + shares * (silhouette.radii[:, 1] - silhouette.radii[:, 0])
    return (np.linalg.norm(ways - shares[..., None] * axes, axis=2) - radii).min(axis=1)


def test_hits_lie_on_the_silhouette_and_those_on_the_head_on_its_head(sampler: PoseSampler) -> None:
    silhouette = build_silhouette(sampler.policies[0].database)
    hits = find_hits(sampler, silhouette)
    assert hits.count == len(hits.points) == int(np.count_nonzero(sampler.take.events.landed)) > 3
    # Strikes land on skins, which are wider than the capsules of trunks. A few fists do not reach what they hit.
    assert np.quantile(np.abs(surface_gaps(hits.points, silhouette)), 0.9) < 0.05
    on_head = hits.points[hits.on_head]
    far = np.linalg.norm(on_head - silhouette.head, axis=1) - silhouette.head_radius
    assert len(on_head) > 0
    # The head of a skin is no ball.
    assert np.quantile(np.abs(far), 0.9) < 0.03
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
