"""Mutated YAML files: valid, or refused with the position of every finding."""

import random
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml
from mutating import flow, mutate, mutate_tree
from pydantic import BaseModel

from crowdsim.config.files import find_faults

_LINE = re.compile(r"mutated\.yaml:[1-9]\d*:[1-9]\d*: \S[^\n]*")


def maker(seeds: Sequence[bytes]) -> Callable[[random.Random], bytes]:
    """Return what makes an input from a generator; most are made of the first seed, the smallest."""
    trees = [yaml.load(seed, Loader=yaml.CSafeLoader) for seed in seeds]

    def make(rng: random.Random) -> bytes:
        at = 0 if rng.random() < 0.7 else min(rng.randrange(len(seeds)), rng.randrange(len(seeds)))
        if rng.random() < 0.4:
            text = flow(mutate_tree(rng, trees[at]))
            return text if rng.random() < 0.8 else mutate(rng, text, seeds[0])
        return mutate(rng, seeds[at], rng.choice(seeds))

    return make


def reader(
    folder: Path, model: type[BaseModel], context: dict[str, Any], use: Callable[[Path], None]
) -> Callable[[bytes], None]:
    """Return what reads an input from a file in a folder, checks its findings, and uses it where there are none."""
    path = folder / "mutated.yaml"

    def read(text: bytes) -> None:
        path.write_bytes(text)
        findings = find_faults(path, model, (), context)
        for finding in findings:
            line = str(finding).removeprefix(f"{folder}/")
            assert _LINE.fullmatch(line), line
        if not findings:
            use(path)

    return read
