"""Frame rates as fractions: exact in scenarios, on the command line and in files."""

import json
import struct
import subprocess
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from scenes import crowdsim, scene, write_scene

from crowdsim.errors import CrowdsimError, ScenarioError
from crowdsim.runs.opening import open_run
from crowdsim.scenario.rates import exact_rate, parse_rate, rate_text
from crowdsim.scenario.scenario import dump_scenario, load_scenario

FILM = 24000 / 1001


@pytest.mark.parametrize(
    ("given", "rate", "text"),
    [
        ("24000/1001", Fraction(24000, 1001), "24000/1001"),
        (Fraction(30000, 1001), Fraction(30000, 1001), "30000/1001"),
        (" 60000 / 1001 ", Fraction(60000, 1001), "60000/1001"),
        ("50/2", Fraction(25), "25"),
        ("12.5", Fraction(25, 2), "12.5"),
        (23.976, Fraction(23976, 1000), "23.976"),
        (59.9401, Fraction(599401, 10000), "59.9401"),
        (1000, Fraction(1000), "1000"),
    ],
)
def test_rates_keep_their_exact_value(given: str | float | Fraction, rate: Fraction, text: str) -> None:
    fps = parse_rate(given)
    assert fps == float(rate)
    assert exact_rate(fps) == rate
    assert rate_text(fps) == text
    assert parse_rate(text) == fps


@pytest.mark.parametrize(
    "given", ["24000/0", "24000/1009", "1/2", "2001/2", "24/", "a", "nan", "inf", 0.5, 1001, "-24/1"]
)
def test_what_is_no_rate_is_refused(given: str | float) -> None:
    with pytest.raises(CrowdsimError) as raised:
        parse_rate(given)
    assert str(raised.value) == (
        f"fps is {given}, expected a number from 1 to 1000, or "
        "a fraction with a denominator of 1 to 1001, such as 24000/1001"
    )


def test_scenarios_take_fractions_and_are_written_with_them(workplace: Path) -> None:
    outputs = {"bvh": {}, "ply": {"fps": "30000/1001"}, "render": {"fps": "24000/1001"}}
    scenario = load_scenario(scene(fps="24000/1001", outputs=outputs))
    assert scenario.fps == scenario.outputs.bvh.fps == scenario.outputs.render.fps == FILM
    assert scenario.outputs.ply.fps == 30000 / 1001
    text = dump_scenario(scenario)
    assert text.count("fps: 24000/1001\n") == 3
    assert load_scenario(scene(fps=60)).fps == 60
    assert "fps: 60.0\n" in dump_scenario(load_scenario(scene(fps=60)))
    assert "--fps 24000/1001 " in " ".join([*scenario.outputs.bvh.command("run"), ""])


@pytest.mark.parametrize(
    ("fps", "what"),
    [
        ("24000/0", "is '24000/0', expected a fraction with a denominator of 1 to 1001, such as 24000/1001"),
        ("film", "is 'film', expected a number from 1 to 1000 or text such as 24000/1001"),
        ("1/2", "is '1/2', expected a number from 1 to 1000 or text such as 24000/1001"),
        (2000, "is 2000, expected a number from 1 to 1000 or text such as 24000/1001"),
    ],
)
def test_scenarios_say_what_is_no_rate(workplace: Path, fps: str | float, what: str) -> None:
    for changes, where in (({"fps": fps}, "fps"), ({"outputs": {"bvh": {"fps": fps}}}, "outputs.bvh.fps")):
        with pytest.raises(ScenarioError) as raised:
            load_scenario(scene(**changes))
        assert str(raised.value).endswith(f"{where}: {what}")


def test_files_have_the_exact_rate(workplace: Path, capsys) -> None:
    from crowdsim.render.video import ffmpeg

    write_scene(workplace / "four.yaml")
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert crowdsim("export", "run", "--bvh", "--glb", "--fps", "24000/1001", "--out", "a") == 0
    assert "Frame Time: 0.0417083333\n" in (workplace / "a" / "bvh" / "red_0.bvh").read_text()
    data = (workplace / "a" / "glb" / "take.glb").read_bytes()
    document = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])
    assert document["scenes"][0]["extras"]["fps"] == "24000/1001"
    files = open_run("run").export("bvh", "b", fps="24000/1001")
    assert files[0].read_bytes() == (workplace / "a" / "bvh" / "red_0.bvh").read_bytes()
    assert crowdsim("render", "run", "--fps", "24000/1001", "--frames", "0:3", "--size", "64x48", "--out", "v") == 0
    probe = subprocess.run([ffmpeg(), "-hide_banner", "-i", "v/video.mp4", "-map", "0:v", "-f", "framehash", "-"],
                           capture_output=True, text=True, check=True)  # fmt: skip
    base = next(line for line in probe.stdout.splitlines() if line.startswith("#tb 0: "))
    rows = [line.split(",") for line in probe.stdout.splitlines() if not line.startswith("#")]
    times = np.array([int(row[2]) for row in rows]) * Fraction(base.removeprefix("#tb 0: "))
    assert list(times) == [Fraction(1001 * frame, 24000) for frame in range(3)]
    capsys.readouterr()
    assert crowdsim("export", "run", "--bvh", "--fps", "1001") == 2
    assert "fps is 1001, expected a number from 1 to 1000" in capsys.readouterr().err
