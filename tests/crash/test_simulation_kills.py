"""Simulations that are killed go on from their last checkpoint to the same bytes: little is simulated again."""

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from scenes import write_scene

sys.path.insert(0, str(Path(__file__).parent))
from forking import Server
from test_crash import RUN, contents
from traps import LOG

from crowdsim.runs.checkpoint import frames_done

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a system that forks")

FRAMES, CHUNK, STEP, AVATARS = 200, 16, 5, 4
SMALL = {"avatar_frames": STEP * AVATARS, "events": 8}
"""Steps end in the midst of chunks, and strikes fill several: none does damage, so that some are all zero."""


@pytest.fixture
def server(workplace: Path) -> Iterator[Server]:
    """A warm process in a folder with a scene that writes only its take, and the run ``undisturbed``."""
    write_scene(workplace / "four.yaml", duration=FRAMES, outputs={"take": {"chunk": CHUNK}})
    server = Server(workplace, [RUN])
    shutil.rmtree(workplace / "work")
    assert server.run(*RUN, trap=SMALL) == 0, server.said()
    shutil.move(workplace / "work", workplace / "undisturbed")
    damage = workplace / "undisturbed" / "take.zarr" / "events" / "damage"
    assert len([path for path in damage.iterdir() if path.name.isdecimal()]) > 3
    yield server
    server.close()


def simulated(server: Server) -> list[int]:
    """Return which control frames have been simulated since this was asked last."""
    log = server.folder / LOG
    steps = [line.split() for line in log.read_text(encoding="utf-8").splitlines()] if log.exists() else []
    log.unlink(missing_ok=True)
    return [int(first) + k for first, count in steps for k in range(int(count))]


KILLS = [
    [("step", 2)],
    [("step", 40)],
    [("array", 1)],
    [("array", 4)],
    [("array", 45)],
    [("checkpoint", 2)],
    [("step", 9), ("array", 8), ("checkpoint", 2), ("step", 6)],
]


def test_a_killed_simulation_goes_on_from_its_checkpoint_to_the_same_bytes(server: Server) -> None:
    work = server.folder / "work"
    simulated(server)
    for kills in KILLS:
        begun = 0
        for place, number in kills:
            assert server.run(*RUN, trap={**SMALL, "place": place, "number": number}) == -9, server.said()
            done, kept = simulated(server), frames_done(work / ".run.partial")
            assert done == list(range(begun, begun + len(done))), kills
            # The first step has a checkpoint at once; what comes after the last one is simulated again.
            assert begun < kept < begun + len(done), kills
            begun = kept
        assert server.run(*RUN, trap=SMALL) == 0, server.said()
        said = server.said()
        assert said.index(f"continuing after {begun} control frames") < said.index("control: "), kills
        assert simulated(server) == list(range(begun, FRAMES)), kills
        assert contents(work) == contents(server.folder / "undisturbed"), kills
        shutil.rmtree(work)
