"""Pictures of a run know the arena of its scenario."""

from pathlib import Path

import pytest
from scenes import crowdsim, write_scene

from crowdsim.runs.opening import open_run


@pytest.mark.parametrize(
    ("arena", "numbers"),
    [
        ({"kind": "circle", "radius": 8, "centre": [1, -2]}, [1, 1, -2, 8, 8]),
        ({"kind": "rectangle", "size": [6, 10]}, [2, 0, 0, 3, 5]),
        ({"kind": "none"}, [0, 0, 0, 0, 0]),
    ],
)
def test_the_arena_is_that_of_the_scenario_that_was_run(workplace: Path, arena: dict, numbers: list[float]) -> None:
    write_scene(workplace / "four.yaml", arena=arena, duration=3)
    assert crowdsim("run", "four.yaml", "--out", "run", "--quiet") == 0
    assert open_run(workplace / "run").arena.tolist() == numbers


def test_without_a_readable_scenario_ground_is_open(workplace: Path) -> None:
    write_scene(workplace / "four.yaml", arena={"kind": "circle", "radius": 8}, duration=3)
    assert crowdsim("run", "four.yaml", "--out", "run", "--quiet") == 0
    resolved = workplace / "run" / "scenario.resolved.yaml"
    whole = resolved.read_text()
    for text in ("", "arena: [", "arena: {kind: moon}", "name: four", whole.replace("radius: 8.0", "radius: -8.0")):
        resolved.write_text(text)
        run = open_run(workplace / "run")
        assert not run.arena.any()
        (note,) = run.notes
        assert note.startswith(f"{resolved}: cannot be read: ")
        assert note.endswith("; arena, obstacles, cameras and health of the run are not shown")
    resolved.unlink()
    run = open_run(workplace / "run")
    assert (run.arena.any(), run.notes) == (False, ())
    resolved.symlink_to("/dev/zero")
    assert not open_run(workplace / "run").arena.any()


def test_the_border_is_in_the_pictures_of_render_and_of_run_alike(workplace: Path) -> None:
    pictures = {"png": True, "mp4": False, "fps": 15, "size": [160, 96], "frames": [0, 1], "camera": "side"}
    for name, arena in (("ring", {"kind": "circle", "radius": 1.5}), ("open", {"kind": "none"})):
        write_scene(workplace / f"{name}.yaml", name="four", arena=arena, duration=3, outputs={"render": pictures})
        assert crowdsim("run", f"{name}.yaml", "--out", name, "--quiet") == 0
        size = ["--size", "160x96", "--fps", "15", "--frames", "0:1", "--camera", "side"]
        assert crowdsim("render", name, "--png", *size, "--out", f"{name}_again", "--quiet") == 0
    ring, again, free = (
        (workplace / name / "frames" / "000000.png").read_bytes() for name in ("ring", "ring_again", "open")
    )
    assert ring == again
    assert ring != free
