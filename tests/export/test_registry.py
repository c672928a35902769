"""Another output is another file, and nothing else: one that is put beside the others in a process of its own."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scenes import write_scene

from crowdsim.runs.opening import open_run
from crowdsim.scenario.output import Extent, Output
from crowdsim.scenario.outputs import REGISTRY

ONE_FILE = '''
"""Bodies of all avatars in one file: skeletons, colours and poses, as formats of scenes have them."""

import json

import numpy as np

from crowdsim.export.posed import PosedOutput, extent_of


class BodiesOutput(PosedOutput):
    """Bodies of all avatars as one JSON file."""

    name = "bodies"
    about = "Bodies of all avatars as one JSON file."
    kernels = "bvh"

    digits: int = 3

    @classmethod
    def posed_pattern(cls):
        return r"bodies/take\\.json"

    def posed_files(self, extent, names):
        yield "bodies/take.json"

    def cost(self, extent):
        return 1000.0 * self.frame_count(extent), 1.0

    def sink(self, sampler, folder, missing=None):
        return Sink(self, sampler, folder / "take.json")


class Sink:
    kind, margin, reads_joints, total, done = "bodies", 0, False, 1, 0

    def __init__(self, output, sampler, path):
        self.output, self.path, self.cast = output, path, sampler.take.cast
        self.start, self.stop = output.frames_of(extent_of(sampler.take))
        self.avatars = np.array(output.chosen(len(self.cast.names)))
        self.rows = []

    def split(self, most):
        return [self]

    def write(self, block, pool):
        for frame in range(block.first_output, block.stop_output):
            for poses in block.poses:
                at = poses.at(frame - block.first)
                self.rows.append([at.root_positions[0].round(self.output.digits).tolist(), list(poses.skeleton.names)])

    def close(self):
        colours = np.nan_to_num(self.cast.colours[self.cast.types[self.avatars]], nan=-1).tolist()
        self.path.write_text(json.dumps({"colours": colours, "frames": self.rows}))
        return [self.path]

    def abandon(self):
        pass


OUTPUT = BodiesOutput
'''
PROGRAM = """
import crowdsim.outputs; crowdsim.outputs.__path__.append("more")
import contextlib, io, json, sys
from crowdsim.cli import main

for words in json.loads(sys.argv[1]):
    sys.argv, code, said, wrong = ["crowdsim", *words], 0, io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(wrong):
        try:
            main()
        except SystemExit as leave:
            code = leave.code or 0
    print(json.dumps([code, said.getvalue(), wrong.getvalue()]))
"""


def crowdsim(*commands: str) -> Iterator[tuple[int, str, str]]:
    """Run commands in one process that has the output beside the others; yield the code, output and errors of each."""
    words = json.dumps([command.split() for command in commands])
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, words], capture_output=True, text=True, timeout=300, check=True
    )
    return (tuple(json.loads(line)) for line in done.stdout.splitlines())


def test_an_output_that_is_one_more_file_is_written_exported_checked_and_described(workplace: Path) -> None:
    (workplace / "more").mkdir()
    (workplace / "more" / "bodies.py").write_text(ONE_FILE)
    bodies = {"fps": 15, "frames": [0, 4], "avatars": [0, 9]}
    write_scene(workplace / "wrong.yaml", outputs={"bodies": bodies})
    write_scene(workplace / "four.yaml", outputs={"bodies": {**bodies, "avatars": [0, 2]}})
    wrong, done, status, verified, again, help_text, schema, plan = crowdsim(
        "validate wrong.yaml", "run four.yaml --out run", "status run --json", "verify run",
        "export run --bodies --fps 30 --digits 1 --out again", "export --help", "schema",
        "batch four.yaml --seeds 0:2 --dry-run",
    )  # fmt: skip
    assert wrong[0] == 2
    assert "outputs.bodies.avatars[1]: is 9, expected an avatar from 0 to 3" in wrong[2]
    assert [one[0] for one in (done, status, verified, again, help_text, schema, plan)] == [0] * 7
    assert "bodies          run/bodies (2 files, " in done[1]
    held = json.loads((workplace / "run" / "bodies" / "take.json").read_text())
    assert (len(held["colours"]), len(held["frames"])) == (2, 4)
    opened = open_run_without(workplace / "run")
    np.testing.assert_allclose(held["frames"][3][0][1], opened.joints(2, 0.2)[0], atol=6e-4)
    assert json.loads(status[1])["run"]["outputs"] == {"bodies": {"done": 2, "planned": 2}}
    assert len(json.loads((workplace / "again" / "bodies" / "take.json").read_text())["frames"]) == 80
    assert "Bodies of all avatars as one JSON file." in help_text[1]
    assert "--digits N" in help_text[1]
    assert '"BodiesOutput"' in schema[1]


def open_run_without(folder: Path):
    """Return a run, whose manifest lists a file that this process knows nothing of."""
    manifest = folder / "manifest.json"
    kept = manifest.read_bytes()
    manifest.unlink()
    try:
        return open_run(folder)
    finally:
        manifest.write_bytes(kept)


@pytest.mark.parametrize("output", REGISTRY.values(), ids=list(REGISTRY))
def test_every_output_names_its_files_as_manifests_know_them(output: type[Output]) -> None:
    import re

    from crowdsim.export.posed import file_names
    from crowdsim.runs.manifest import is_written

    names = file_names(output().resolved(30.0), Extent(3, 40, 15.0), ["a", "b", "c"])
    assert bool(names) != output.always
    assert all(is_written(name) for name in names)
    assert all(re.fullmatch(output.pattern(), name) for name in names)
    assert output.about.endswith(".")
    size, seconds = output().cost(Extent(3, 40, 15.0))
    assert (size > 0) == (seconds > 0) == output.from_take
