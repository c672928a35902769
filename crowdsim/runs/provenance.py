"""What a run is made from: where it all is the same, a run that was interrupted goes on as if nothing had happened."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from typing import TYPE_CHECKING, Any

from crowdsim import __version__, assets
from crowdsim.machine import describe_machine
from crowdsim.runs.manifest import checksum

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

_PACKAGES = ("numpy", "numba", "numcodecs")
_SOURCES = (
    "body", "core", "crowd", "export", "jit", "outputs", "places", "policy", "poses", "preparation", "render", "runs",
    "scenario", "take", "view",
)  # fmt: skip
"""Folders of the package whose code decides what a run writes, beside what its policies' fingerprints cover."""
_DIFFERENCE_LINES = 40


@dataclass(frozen=True)
class Origin:
    """What a run is made from.

    Attributes:
        scenario: The resolved scenario, as text.
        policies: Fingerprints of its policies, by name.
        versions: Versions of crowdsim and of packages that decide what it writes, and its sources' checksum.
        processor: What runs it, since rounding depends on it.
    """

    scenario: str
    policies: dict[str, str]
    versions: dict[str, str]
    processor: str

    def document(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {"policies": self.policies, "versions": self.versions, "processor": self.processor}

    @property
    def checksum(self) -> str:
        """SHA-256 of all of it."""
        return checksum({"scenario": self.scenario, **self.document()})


def origin_of(resolved: str, policies: Sequence[Policy]) -> Origin:
    """Return what a run of a resolved scenario with these policies is made from, here and now."""
    versions = {"crowdsim": __version__, "sources": sources_hash()}
    versions.update({package: _version(package) for package in _PACKAGES})
    fingerprints = {policy.name: policy.fingerprint for policy in policies}
    return Origin(resolved, fingerprints, versions, str(describe_machine()["machine"]["processor"]))


@cache
def _version(package: str) -> str:
    return metadata.version(package)


@cache
def sources_hash() -> str:
    """Return the checksum of the code that decides what a run writes."""
    return assets.sources_hash(_SOURCES)


def scenario_difference(before: str, now: str) -> list[str]:
    """Return how two resolved scenarios differ, line by line."""
    lines = difflib.unified_diff(before.splitlines(), now.splitlines(), "run there", "asked for", "", "", 0, "")
    return list(lines)[:_DIFFERENCE_LINES]


def document_difference(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Return how two descriptions by ``Origin.document`` differ, a line each."""
    lines = []
    for part, word in (("policies", "policy"), ("versions", "version of")):
        old, new = (some if isinstance(some, dict) else {} for some in (before.get(part), after.get(part)))
        for name in sorted(old.keys() | new.keys()):
            if old.get(name) != new.get(name):
                lines.append(f"{word} {name}: was {_short(old.get(name))}, is {_short(new.get(name))}")
    if before.get("processor") != after.get("processor"):
        lines.append(f"processor: was {before.get('processor')}, is {after.get('processor')}")
    return lines


def _short(value: object) -> str:
    text = "none" if value is None else str(value)
    return f"{text[:12]}..." if len(text) > 32 else text
