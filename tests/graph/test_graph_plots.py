import numpy as np
import pytest
import synthetic_motion
from PIL import Image

from crowdsim.errors import OutputError
from crowdsim.graph.motion_graph import build_graph
from crowdsim.graph.plots import degree_figure, distance_figure, length_figure, plot_graph
from crowdsim.graph.settings import GraphSettings

SETTINGS = GraphSettings(threshold=0.3)


@pytest.fixture(scope="module")
def database():
    generator = np.random.default_rng(11)
    return synthetic_motion.database([synthetic_motion.wander(generator, n) for n in (150, 90)])


@pytest.fixture(scope="module")
def graph(database):
    return build_graph(database, SETTINGS)


def test_three_pictures_are_written_and_nothing_else(database, graph, tmp_path):
    paths = plot_graph(database, graph, SETTINGS, tmp_path / "plots")
    assert sorted(path.name for path in paths) == ["action_lengths.png", "degrees.png", "distances.png"]
    assert sorted((tmp_path / "plots").iterdir()) == sorted(paths)
    for path in paths:
        assert np.asarray(Image.open(path)).std() > 5


def test_every_axis_of_a_plot_has_a_label(database, graph):
    (matrix, *scales), degrees = distance_figure(database, graph, SETTINGS).axes, degree_figure(graph).axes
    (lengths,) = length_figure(graph, database.control_rate).axes
    assert [matrix.get_xlabel(), matrix.get_ylabel()] == [
        "control frame i [frames]", "control frame j [frames, by clip]",
    ]  # fmt: skip
    assert all(axes.get_xlabel().endswith("[m]") for axes in scales)
    assert all(axes.get_xlabel().startswith("number of actions") for axes in degrees)
    assert lengths.get_xlabel() == "length of an action [control frames, 15 per second]"
    assert [axes.get_xlabel() for axes in lengths.child_axes] == ["length of an action [s]"]
    assert {axes.get_ylabel() for axes in (*degrees, lengths)} == {"number of states", "number of actions"}


def test_every_transition_is_a_dot_at_the_pair_of_frames_that_are_alike(database, graph):
    axes = distance_figure(database, graph, SETTINGS).axes[0]
    dots = axes.collections[0].get_offsets()
    assert np.array_equal(dots[:, 0], graph.transition_from)
    assert np.array_equal(dots[:, 1], graph.transition_to - 1)


def test_the_distance_matrix_is_dark_on_its_diagonal_and_symmetric(database, graph):
    costs = np.asarray(distance_figure(database, graph, SETTINGS).axes[0].images[0].get_array())
    assert costs.shape == (240, 240)
    assert np.abs(np.diag(costs)).max() < 1e-5
    assert np.abs(costs - costs.T).max() < 1e-5


def test_a_folder_that_cannot_be_made_is_an_output_error(database, graph, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        plot_graph(database, graph, SETTINGS, tmp_path / "file" / "plots")
