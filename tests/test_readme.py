"""What README and the documentation say can be done can be done."""

import re
from pathlib import Path

import pytest

from crowdsim.scenario.scenario import load_scenario

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def name(path: Path) -> str:
    return path.name


@pytest.mark.parametrize("block", re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL))
def test_scenarios_in_the_readme_are_valid(block: str, tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(block, encoding="utf-8")
    assert load_scenario(path).avatar_count > 0


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_in_the_documentation_exist(page: Path) -> None:
    from typer.main import get_command

    from crowdsim.cli import app

    text = page.read_text(encoding="utf-8")
    shell = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL))
    named = {*re.findall(r"^crowdsim (\w+)", shell, re.MULTILINE), *re.findall(r"`crowdsim (\w+)", text)}
    assert named <= set(get_command(app).commands)


def test_every_command_is_documented() -> None:
    from typer.main import get_command

    from crowdsim.cli import app

    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert set(get_command(app).commands) <= set(re.findall(r"^\| `crowdsim (\w+)", text, re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_files_and_make_targets_in_the_documentation_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"`make ([\w-]+)", text):
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE), target
    for link in re.findall(r"\]\(((?!http)[\w./-]+)\)", text):
        assert (page.parent / link).exists(), link
    for benchmark in re.findall(r"`benchmarks/(\w+\.py)`", text):
        assert (ROOT / "benchmarks" / benchmark).exists(), benchmark
