"""What the README says can be done can be done."""

import re
from pathlib import Path

import pytest

from crowdsim.crowd.scenario import load_scenario

TEXT = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("block", re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL))
def test_scenarios_in_the_readme_are_valid(block: str, tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(block, encoding="utf-8")
    assert load_scenario(path).avatar_count > 0


def test_commands_in_the_readme_exist() -> None:
    from typer.main import get_command

    from crowdsim.cli import app

    known = set(get_command(app).commands)
    shell = "\n".join(re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL))
    named = {*re.findall(r"^crowdsim (\w+)", shell, re.MULTILINE), *re.findall(r"`crowdsim (\w+)", TEXT)}
    assert named
    assert named <= known


def test_files_and_make_targets_in_the_readme_exist() -> None:
    root = Path(__file__).parents[1]
    for target in re.findall(r"`?make ([\w-]+)", TEXT):
        assert re.search(rf"^{target}:", (root / "Makefile").read_text(encoding="utf-8"), re.MULTILINE), target
    for name in re.findall(r"\]\(((?!http)[\w./-]+)\)", TEXT):
        assert (root / name).exists(), name
