"""Misspelt keys of the shipped scenarios and recipes get the right suggestion, at their line and column."""

import string
from pathlib import Path

import pytest
import yaml

from crowdsim import assets
from crowdsim.config.files import find_faults
from crowdsim.config.schema import chosen, keys, members, schema_of, step
from crowdsim.scenario.scenario import Scenario
from crowdsim.training.recipe import Recipe

ROOT = Path(__file__).resolve().parents[2]


def fixed_keys(node, data, part):
    """Yield the node, the siblings and the place in the schema of every key that the format names, not the author."""
    part = chosen(part, data) if members(part) else part
    if isinstance(data, dict):
        for key_node, value_node in node.value:
            key = key_node.value
            if key in keys(part):
                yield key_node, set(data), (id(part), key)
            yield from fixed_keys(value_node, data[key], step(part, key))
    elif isinstance(data, list):
        for at, item in enumerate(data):
            yield from fixed_keys(node.value[at], item, step(part, at))


def one_letter_typos(word):
    """Yield every deletion and every swap of neighbours, and one substitution of each letter."""
    letters = string.ascii_lowercase
    for i in range(len(word)):
        yield word[:i] + word[i + 1 :]
        yield word[:i] + word[i : i + 2][::-1] + word[i + 2 :]
        yield word[:i] + letters[(letters.find(word[i]) + 7 + i) % 26] + word[i + 1 :]


@pytest.mark.parametrize(("folder", "model"), [("scenarios", Scenario), ("policies", Recipe)])
@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.slow)])
def test_one_letter_typos_in_keys_of_shipped_files_get_the_right_suggestion(folder, model, every, tmp_path):
    wrong, places, tried = [], set(), 0
    context = {"folder": ROOT / folder, "policies": assets.policy_names()}
    for path in sorted((ROOT / folder).glob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        for node, siblings, place in fixed_keys(yaml.compose(text), yaml.safe_load(text), schema_of(model)):
            if place in places:
                continue
            places.add(place)
            for typo in sorted(set(one_letter_typos(node.value)) - {"", *siblings})[len(places) % every :: every]:
                tried += 1
                file = tmp_path / "typo.yaml"
                file.write_text(text[: node.start_mark.index] + typo + text[node.end_mark.index :], encoding="utf-8")
                found = [str(finding) for finding in find_faults(file, model, context=context)]
                where = f"{file}:{node.start_mark.line + 1}:{node.start_mark.column + 1}: "
                if not any(each.startswith(where) and each.endswith(f"'{node.value}'?)") for each in found):
                    wrong.append((node.value, typo, found))
    assert tried > 500 / every
    assert len(wrong) <= 0.02 * tried, wrong
