"""Takes in memory: frames that are collected during a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.take.header import TakeHeader
from crowdsim.take.take import VARIABLES, Events, Take

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


class TakeCollector:
    """Collects a take chunk by chunk, as ``store.TakeWriter`` writes one.

    Args:
        header: What is known beforehand.
        policies: The policies of the take.
    """

    def __init__(self, header: TakeHeader, policies: Sequence[Policy]) -> None:
        self._header, self._policies = header, tuple(policies)
        self._chunks: list[dict[str, Array]] = []
        self._events: list[Events] = []
        self._targets: list[Array] = []
        self._status = "running"

    def append(self, chunk: dict[str, Array], events: Events, targets: Array | None = None) -> None:
        """Add control frames: an array (n, N) for each of ``VARIABLES``, the strikes thrown, and targets."""
        self._chunks.append(chunk)
        self._events.append(events)
        self._targets.append(np.zeros((len(chunk["x"]), 0, 3), np.float32) if targets is None else targets)

    def close(self, status: str = "done") -> None:
        """Finish the take."""
        self._status = status

    def take(self) -> Take:
        """Return the finished take."""
        header = self._header
        names = Events.__dataclass_fields__
        events = Events(**{name: np.concatenate([getattr(one, name) for one in self._events]) for name in names})
        return Take(
            **{name: np.concatenate([chunk[name] for chunk in self._chunks]) for name in VARIABLES},
            cast=header.cast,
            targets=np.concatenate(self._targets),
            target_names=header.target_names,
            events=replace(events, frame=events.frame.astype(np.float32)),
            control_rate=header.control_rate,
            scenario=header.scenario,
            seed=header.seed,
            fingerprints=header.fingerprints,
            status=self._status,
            reactions=header.reactions,
            collision_avoidance=header.collision_avoidance,
            policies=self._policies,
        )
