"""A small real bundle and a small real run: their mutants, the checks that these meet, and what is done with others."""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mutants import Rng, mutate_array, mutate_json
from on_disk import run_on_disk

from crowdsim.array_checks import ArrayFault, check_shape, check_table
from crowdsim.config.documents import document_fault
from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.script import Change, CirclePath
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.triggers import AtFrame, Landed
from crowdsim.errors import PolicyError, TakeError
from crowdsim.policy.bundle import map_arrays, read_document
from crowdsim.policy.document import PolicyDocument
from crowdsim.policy.flattening import assemble_policy, check_flattened
from crowdsim.policy.policy import Policy
from crowdsim.poses.known_actions import with_known_actions
from crowdsim.poses.sampler import PoseSampler
from crowdsim.take import checks
from crowdsim.take.header import TakeHeader
from crowdsim.take.layout import CAST
from crowdsim.take.memory import TakeCollector
from crowdsim.take.metadata import TakeAttributes, read_metadata
from crowdsim.take.store import open_take
from crowdsim.take.take import VARIABLES, Cast, Events, Take

Arrays = dict[str, np.ndarray]
TWINS = {
    "actions_offsets": "graph_action_offsets", "actions_next": "graph_action_next",
    "actions_lengths": "graph_action_lengths",
}  # fmt: skip
"""Arrays that must be alike: who knows the format changes both."""
FRAMES, AVATARS = 24, 4
FAULTS: dict[str, Callable[[], Any]] = {
    "crash": lambda: ctypes.string_at(0),
    "hang": lambda: sum(1 for _ in iter(int, 1)),
    "traceback": lambda: [][1],
    "memory": lambda: np.ones(1 << 27),
}
"""What a mutant must never lead to, so that it is known to be noticed."""


class Base:
    """What mutants are made from.

    Args:
        folder: A folder with the bundle ``policies/tiny`` and the run ``run``.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        bundle = folder / "policies" / "tiny"
        self.document = read_document(bundle)
        self.arrays = {name: np.array(values) for name, values in map_arrays(bundle, self.document).items()}
        self.names = sorted(self.arrays)
        self.policy = assemble_policy(self.document, self.arrays)
        self.take = open_take(folder / "run")
        self.attributes = read_metadata(folder / "run" / "take.zarr", ".zattrs")
        self.columns = self._columns()
        self.state = self._state()

    def run(self, kind: str, seed: int) -> None:
        """Make a mutant, and do with it what is done with bundles and runs."""
        if kind == "bundle":
            document, arrays = self.bundle_mutant(seed)
            self.check_bundle(document, arrays)
            self.use_policy(document, arrays)
        elif kind == "take":
            self.use_take(self.checked_take(*self.take_mutant(seed)))
        elif kind == "state":
            self.use_state(self.state_mutant(seed))
        elif kind in FAULTS:
            FAULTS[kind]()
        else:
            run_on_disk(self, kind, seed)

    def warm_up(self) -> None:
        """Do with what is not changed what is done with mutants, so that everything is loaded."""
        self.use_policy(self.document, self.arrays)
        self.use_take(self.checked_take(self.attributes, self.columns))
        self.use_state(self.state)
        for kind in ("bundle files", "run files", "archive"):
            run_on_disk(self, kind, None)

    # Bundles

    def bundle_mutant(self, seed: int) -> tuple[dict[str, Any], Arrays]:
        """Return the plain data and the arrays of a bundle, changed in one to three places."""
        rng = np.random.default_rng(seed)
        document, arrays = self.document, dict(self.arrays)
        for _ in range(int(rng.integers(1, 4)) if rng.random() < 0.3 else 1):
            if rng.random() < 0.15:
                document = _mutate_document(rng, document)
                continue
            name = self.names[int(rng.integers(len(self.names)))]
            if rng.random() < 0.02:
                arrays.pop(name, None)
            elif name in arrays:
                arrays[name] = mutate_array(rng, arrays[name])
                if name in TWINS and rng.random() < 0.5:
                    arrays[TWINS[name]] = arrays[name]
        return document, arrays

    def check_bundle(self, document: dict[str, Any], arrays: Arrays) -> None:
        """Check a bundle as reading it does.

        Raises:
            PolicyError: It is not as it must be.
        """
        # A document that has not changed has been checked.
        fault = document is not self.document and document_fault(PolicyDocument, document)
        if fault:
            raise PolicyError(fault)
        missing = [name for name in self.arrays if name not in arrays]
        if missing:
            raise PolicyError(f"lacks {missing[0]}")
        try:
            check_flattened(document, arrays)
        except ArrayFault as fault:
            raise PolicyError(str(fault)) from None

    def use_policy(self, document: dict[str, Any], arrays: Arrays) -> None:
        """Use a policy, see ``use_read_policy``."""
        self.use_read_policy(assemble_policy(document, arrays))

    def use_read_policy(self, policy: Policy) -> None:
        """Inspect a policy, let avatars fight by it, and pose them."""
        from crowdsim.commands.policy_text import policy_lines
        from crowdsim.training.statistics import inspect_bundle

        policy_lines(inspect_bundle(policy))
        self._pose(_recorded(policy), policy)

    # Takes

    def _columns(self) -> Arrays:
        take = self.take
        columns = {name: np.array(getattr(take, name)[:]) for name in VARIABLES}
        fields = {name: field for name, field in CAST.items() if name not in ("name", "group")}
        columns |= {name: np.array(getattr(take.cast, field)) for name, field in fields.items()}
        columns |= {f"events.{name}": np.array(getattr(take.events, name)) for name in checks.EVENTS}
        return {**columns, "target": np.array(take.targets[:])}

    def take_mutant(self, seed: int) -> tuple[dict[str, Any], Arrays]:
        """Return the attributes and the arrays of a take, changed in one to three places."""
        rng = np.random.default_rng(seed)
        attributes, columns, names = self.attributes, dict(self.columns), list(self.columns)
        for _ in range(int(rng.integers(1, 4)) if rng.random() < 0.3 else 1):
            if rng.random() < 0.15:
                attributes = mutate_json(rng, attributes)
            else:
                name = names[int(rng.integers(len(names)))]
                columns[name] = mutate_array(rng, columns[name])
        return attributes, columns

    def checked_take(self, attributes: dict[str, Any], columns: Arrays) -> Take:
        """Return a take as reading it from disk does.

        Raises:
            TakeError: It is not as it must be.
        """
        fault = attributes is not self.attributes and document_fault(TakeAttributes, attributes)
        if fault:
            raise TakeError(fault)
        kinds = {"N": len(self.take.cast.names), "G": len(attributes["target_names"])}
        sizes = {**kinds, **{f"{kind}s": len(attributes[f"{kind}_names"]) for kind in ("type", "team")}}
        sizes["policies"] = len(attributes["policy_names"])
        table = {name: column for name, column in checks.CAST.items() if name != "group"}
        cast = {name: columns[name] for name in table}
        events = {name: columns[f"events.{name}"] for name in checks.EVENTS}
        try:
            check_table(table, cast, sizes)
            counts = np.full(sizes["N"], len(self.policy.graph.action_first))
            for name, column in checks.FRAMES.items():
                check_shape(name, columns[name].dtype, columns[name].shape, column, sizes)
            checks.check_rows(columns, sizes, counts)
            check_table({"target": checks.TARGET}, {"target": columns["target"]}, sizes)
            check_table(checks.EVENTS, events, sizes)
            checks.check_strikes(events)
        except ArrayFault as fault:
            raise TakeError(str(fault)) from None
        return self._take(attributes, columns, cast, events)

    def _take(self, attributes: dict[str, Any], columns: Arrays, cast: Arrays, events: Arrays) -> Take:
        fields = {name: field for name, field in CAST.items() if name != "name"}
        names = {f"{kind}_names": tuple(attributes[f"{kind}_names"]) for kind in ("type", "team", "policy")}
        return replace(
            self.take,
            **{name: columns[name] for name in VARIABLES},
            cast=Cast(
                names=self.take.cast.names,
                **{fields[name]: values for name, values in cast.items()},
                **names,
                colours=self.take.cast.colours,
            ),
            targets=columns["target"],
            target_names=tuple(attributes["target_names"]),
            events=Events(**events),
            control_rate=attributes["control_rate"],
            fingerprints=tuple(attributes["policy_fingerprints"]),
        )

    def use_take(self, take: Take) -> None:
        """Pose the avatars of a take, and list its strikes."""
        take.strikes()
        self._pose(take, self.policy)

    def _pose(self, take: Take, policy: Policy) -> None:
        sampler = PoseSampler(take, [policy])
        # From the first, and around the middle, where it is the other half that is read.
        for start in (0, take.output_frames(20.0) // 2):
            sampler.sample(start, min(start + 6, take.output_frames(20.0)), 20.0)
        sampler.take = with_known_actions(sampler.take, [policy])

    # States of simulations

    def _simulation(self) -> Simulation:
        late = np.arange(AVATARS) == AVATARS - 1
        changes = (Change(Landed(3), temperatures=np.full(1, 0.3)), Change(AtFrame(9), who=late, present=True))
        script = dict(targets=(CirclePath(2.0, 1.0, (1.0, 1.0), 1.5),), changes=changes)
        return Simulation(replace(_crowd(self.policy, present=~late), policies=[self.policy], **script))

    def _state(self) -> Arrays:
        simulation = self._simulation()
        simulation.run(13)
        return simulation.state()

    def state_mutant(self, seed: int) -> Arrays:
        """Return the state of a simulation, changed in one to three places."""
        rng = np.random.default_rng(seed)
        state, names = dict(self.state), sorted(self.state)
        for _ in range(int(rng.integers(1, 4))):
            # Most of what could lead out of bounds is of avatars.
            some = [name for name in names if name.startswith("avatars.")] if rng.random() < 0.6 else names
            name = some[int(rng.integers(len(some)))]
            state[name] = mutate_array(rng, state[name])
        return state

    def use_state(self, state: Arrays) -> None:
        """Let a simulation go on from a state.

        Raises:
            TakeError: It is not as it must be.
        """
        simulation = self._simulation()
        try:
            simulation.restore(copy.deepcopy(state))
        except ValueError as error:
            raise TakeError(str(error)) from None
        simulation.run(12)


def _crowd(policy: Policy, **more: Any) -> Any:
    weights = policy.weights
    angle = np.arange(AVATARS) * 2 * np.pi / AVATARS
    return build_crowd(
        0.6 * np.sin(angle), 0.6 * np.cos(angle), angle + np.pi, weights=weights, interval=10.0, variety=0.5, **more
    )


def _recorded(policy: Policy) -> Take:
    """Return a short fight by a policy, in memory."""
    names = np.array([f"a{number}" for number in range(AVATARS)])
    zeros, ones = np.zeros(AVATARS, np.int16), np.ones(AVATARS, np.float32)
    cast = Cast(names, zeros, zeros, zeros, ones, ones, ("boxer",), ("all",), ("tiny",), np.full((1, 3), np.nan))
    header = TakeHeader(cast, policy.database.control_rate, "four", 3, (policy.fingerprint,))
    collector = TakeCollector(header, [policy])
    chunk = Simulation(replace(_crowd(policy), policies=[policy])).run(FRAMES)
    collector.append(chunk.variables(), chunk.events, chunk.targets)
    collector.close("done")
    return collector.take()


def _mutate_document(rng: Rng, document: dict[str, Any]) -> dict[str, Any]:
    """Change ``policy.json`` in one place; what decides most, and statistics that are only printed, are as likely."""
    if not isinstance(document, dict):
        return document
    parts = ("behaviours", "body", "skeleton", "database", "target", "graph", "recipe", "statistics")
    if rng.random() < 0.1:
        return mutate_json(rng, document) or {}
    part = parts[int(rng.integers(len(parts)))]
    return {**document, part: mutate_json(rng, document.get(part))}
