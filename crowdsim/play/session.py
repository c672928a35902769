"""A session: a scenario that is simulated step by step while a user interferes, and the scenario that repeats it.

Whatever a user does becomes an event of the scenario, or a key of a target's path, at the control frame at which it
takes effect. The scenario with these, run without anyone, gives the same take to the byte.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from crowdsim.core.types import Array, FileName, Progress
from crowdsim.crowd.chunk import Frame
from crowdsim.crowd.draw import draw_crowd, is_conditioned, reacts
from crowdsim.crowd.entering import REACH
from crowdsim.crowd.events import VARIABLES
from crowdsim.crowd.explaining import Decision
from crowdsim.crowd.jit_warmup import warm_up
from crowdsim.crowd.kernels.layout import DROPS
from crowdsim.crowd.plan import plan_change
from crowdsim.crowd.script import KeyPath
from crowdsim.crowd.simulation import Simulation
from crowdsim.errors import RunError, ScenarioError
from crowdsim.files import copy_plain, make_folder, write_plain
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.scenario.distributions import middle
from crowdsim.scenario.events import Event
from crowdsim.scenario.groups import KeysTarget
from crowdsim.scenario.parts import FARTHEST
from crowdsim.scenario.scenario import Scenario, dump_scenario, load_scenario

if TYPE_CHECKING:
    from crowdsim.crowd.value_map import ValueMap
    from crowdsim.policy.policy import Policy
    from crowdsim.runs.run import Report

LONGEST = 1_000_000
"""Most control frames of a session, some 18 hours."""
HIGHEST = 10.0
"""Height up to which targets can be dragged [m]."""
_EVENT: TypeAdapter[Any] = TypeAdapter(Event)
TUNED = ("temperature", "tempo", "reaction")
"""What can be changed of a type while it fights, beside the weights of its behaviours."""


def boxer_and_target(policy: str, seed: int = 1) -> Scenario:
    """Return the scene of the paper: one avatar of a policy, and a target that waits to be dragged."""
    return load_scenario(
        {
            "name": f"play_{Path(policy).stem}",
            "description": "One boxer, and a target that is dragged",
            "seed": seed,
            "duration": LONGEST,
            "types": {"boxer": {"policy": policy}},
            "groups": [
                {
                    "name": "boxer",
                    "type": "boxer",
                    "count": 1,
                    "placement": {"kind": "points", "points": [[0.0, 0.0]]},
                }
            ],
            "opponents": {"kind": "target", "target": "target"},
            "targets": {"target": {"kind": "keys", "keys": [[0, 0.0, 1.55, 2.0]]}},
        }
    )


class Session:
    """A scenario that is simulated live.

    Args:
        scenario: The scenario, resolved.
        policies: Its policies.
        threads: Threads; results do not depend on them.

    Attributes:
        scenario: The scenario as it is played: without outputs, and without an end but that of its ``until``.
        crowd: Its crowd.
        simulation: The simulation.
        is_changed: Whether a user has interfered since the session was recorded last.
        strikes: Strikes thrown and landed so far.
    """

    def __init__(self, scenario: Scenario, policies: Sequence[Policy], threads: int = 1) -> None:
        self.policies, self._threads = tuple(policies), threads
        played = {"duration": LONGEST, "outputs": type(scenario.outputs)()}
        if scenario.avatar_count > 1 and not is_conditioned(scenario):
            # Avatars that may be taken away have conditions, from the first frame on as in the run that repeats it.
            played["events"] = (_EVENT.validate_python(_event("fight")), *scenario.events)
        self.scenario = scenario.model_copy(update=played)
        self._begin()

    def _begin(self) -> None:
        scenario = self.scenario
        crowd = draw_crowd(scenario, self.policies)
        targets = tuple(
            path if isinstance(path, KeyPath) else KeyPath(crowd.rate, [], [], path) for path in crowd.targets
        )
        self.crowd = replace(crowd, targets=targets)
        self.simulation = Simulation(self.crowd, self._threads, model=warm_up(self.crowd, "auto", False))
        self._events: list[Any] = []
        self._dragged: set[int] = set()
        self._digest = hashlib.sha256()
        self.is_changed = False
        self.strikes = {"thrown": 0, "landed": 0}
        self._weights = {name: self._tuning(name) for name in scenario.types if name in scenario.used_types}
        self._before = {name: self._simulated(name) for name in self._weights}

    def restart(self) -> None:
        """Begin again, as if nobody had interfered."""
        self.simulation.close()
        self._begin()

    def close(self) -> None:
        """End the threads of the simulation."""
        self.simulation.close()

    @property
    def frame(self) -> int:
        """Number of control frames done."""
        return self.simulation.frame

    @property
    def is_over(self) -> bool:
        """Whether the scenario has come to its end."""
        return self.simulation.is_over

    def step(self) -> Frame:
        """Run the next control frame and return it.

        Raises:
            RunError: The scenario has come to its end.
        """
        frame = self.simulation.step()
        self._note(frame)
        self._follow()
        return frame

    def _follow(self) -> None:
        """Note what events of the scenario have changed of the types."""
        for name, tuning in self._weights.items():
            now, before = self._simulated(name), self._before[name]
            for key, value in now.items():
                if value != before.get(key):
                    (tuning["behaviours"] if key in tuning["behaviours"] else tuning)[key] = value
            self._before[name] = now

    def _simulated(self, name: str) -> dict[str, float]:
        """Return what the simulation has for what can be tuned of a type, by its first avatar's group."""
        types, world = self.crowd.cast.types, self.simulation._world
        row = int(self.crowd.cohort[np.argmax(types == list(self.scenario.types).index(name))])
        tuning, cohort = self._weights[name], world.cohorts[row]
        policy = next(one for one in self.policies if one.name == self.scenario.types[name].policy)
        found = {
            one.name: round(float(value), 6)
            for one, value in zip(policy.behaviours, world.weights[row], strict=False)
            if one.name in tuning["behaviours"]
        }
        if DEFEND in tuning["behaviours"]:
            found[DEFEND] = round(float(cohort["defence"]), 6)
        rate = self.crowd.rate
        if "tempo" in tuning and cohort["interval"] > 0.0:
            found["tempo"] = round(60.0 * rate / float(cohort["interval"]), 6)
        if "reaction" in tuning:
            found["reaction"] = round(float(cohort["reaction"]) / rate, 6)
        return {**found, "temperature": round(float(cohort["temperature"]), 6)}

    def _note(self, frame: Frame) -> None:
        for name in VARIABLES:
            self._digest.update(np.ascontiguousarray(getattr(frame, name)).tobytes())
        self._digest.update(frame.targets.tobytes())
        self.strikes["thrown"] += len(frame.events.frame)
        self.strikes["landed"] += int(frame.events.landed.sum())

    def explain(self) -> list[Decision]:
        """Return the decisions of the next control frame, in the order of avatars."""
        return self.simulation.explain()

    def value_map(self, avatar: int) -> ValueMap | None:
        """Return what an avatar's next action is worth by where its opponent stands; None where it decides nothing."""
        return self.simulation.value_map(avatar)

    # What is seen

    def tunings(self) -> dict[str, dict[str, Any]]:
        """Return what can be tuned of each type, and its values now."""
        return self._weights

    def _tuning(self, name: str) -> dict[str, Any]:
        kind = self.scenario.types[name]
        policy = next(one for one in self.policies if one.name == kind.policy)
        own = dict(zip([one.name for one in policy.behaviours], policy.weights.tolist(), strict=False))
        if DEFEND in policy.learned:
            own[DEFEND] = policy.defence_weight
        weights = {one: kind.behaviours.get(one, 0.0) if kind.behaviours else own[one] for one in own}
        found: dict[str, Any] = {"behaviours": weights, "temperature": kind.temperature}
        if kind.tempo is not None:
            found["tempo"] = middle(kind.tempo)
        if reacts(policy):
            found["reaction"] = kind.reaction
        return found

    def health(self) -> tuple[Array, Array]:
        """Return the health of each avatar now, and at the start; 0 of those that nothing hurts. Shape (N,) each."""
        full = np.array(
            [0.0 if kind.damage is None else kind.damage.health for kind in self.scenario.types.values()], np.float32
        )[self.crowd.cast.types]
        conditions = self.simulation.avatars.conditions
        now = conditions["health"].astype(np.float32) if len(conditions) else full
        return np.where(full > 0.0, now, 0.0).astype(np.float32), full

    def down(self) -> Array:
        """Return which avatars fall, lie or get up. Shape (N,), bool."""
        conditions = self.simulation.avatars.conditions
        down: Array = conditions["standing"] >= DROPS if len(conditions) else np.zeros(self.crowd.count, bool)
        return down

    # What a user does

    def tune(self, kind: str, key: str, value: float) -> None:
        """Give avatars of a type another weight of a behaviour, temperature, tempo or time to react.

        Args:
            kind: Name of the type.
            key: ``temperature``, ``tempo``, ``reaction``, or the name of a behaviour.
            value: The new value.

        Raises:
            ScenarioError: There is no such type or key, or the value is out of range.
        """
        if kind not in self._weights:
            raise ScenarioError(f"type {kind!r}: expected one of {', '.join(self._weights)}")
        tuning = self._weights[kind]
        if key in tuning["behaviours"]:
            self._happen(_event("weights", type=kind, behaviours={key: float(value)}))
            tuning["behaviours"][key] = float(value)
        elif key in TUNED and key in tuning:
            self._happen(_event("weights", type=kind, **{key: float(value)}))
            tuning[key] = float(value)
        else:
            known = [*tuning["behaviours"], *(name for name in TUNED if name in tuning)]
            raise ScenarioError(f"{key!r} of type {kind!r}: expected one of {', '.join(known)}")

    def set_on(self, avatar: int, opponent: int | None) -> None:
        """Let an avatar fight another one; with None its opponents are those of its group again.

        Raises:
            ScenarioError: There is no such avatar, or both are one.
        """
        group, member = self._member(avatar)
        if opponent is None:
            opponents = self.scenario.groups[group].opponents
            assert opponents is not None
            chosen = opponents.model_dump(mode="json", exclude_none=True)
        else:
            other, number = self._member(opponent)
            if opponent == avatar:
                raise ScenarioError(f"avatar {avatar} cannot fight itself, expected another one as its opponent")
            chosen = {"kind": "fixed", "group": self.scenario.group_names[other], "member": number}
            chosen["search"] = self.scenario.opponents.search
        self._happen(_event("retarget", group=self.scenario.group_names[group], member=member, opponents=chosen))

    def remove(self, avatar: int) -> None:
        """Take an avatar out of the scene.

        Raises:
            ScenarioError: There is no such avatar, or it is the only one.
        """
        self._come_or_go("remove", avatar)

    def add(self, avatar: int) -> None:
        """Let an avatar come back that has been taken out, where it began, as fresh as at the beginning.

        Raises:
            ScenarioError: There is no such avatar, or it has not been taken out.
        """
        group, member = self._member(avatar)
        name = self.scenario.group_names[group]
        gone = [
            one for one in self._events if one.kind in ("remove", "add") and (one.group, one.member) == (name, member)
        ]
        if not gone or gone[-1].kind != "remove":
            raise ScenarioError(f"avatar {avatar} has not been taken out, expected one that has")
        self._come_or_go("add", avatar)

    def place(self, avatar: int, x: float, z: float) -> str:
        """Put an avatar at a point [m], or beside it where others or obstacles are; return where that is.

        Raises:
            ScenarioError: There is no such avatar, it is not there or down, or there is no room.
        """
        group, member = self._member(avatar)
        name, slot = self.crowd.cast.names[avatar], int(self.simulation.avatars.slot_of[avatar])
        if slot >= self.simulation.present:
            raise ScenarioError(f"{name} is not there, expected an avatar that is")
        if self.simulation.avatars.team[slot] < 0:
            raise ScenarioError(f"{name} is down, expected an avatar that is up")
        if not (np.isfinite([x, z]).all() and max(abs(x), abs(z)) <= FARTHEST):
            raise ScenarioError(f"{name} at {x:g}, {z:g}: expected x and z up to {FARTHEST:g} m")
        x, z = round(float(x), 3), round(float(z), 3)
        found = self.simulation.find_place(avatar, x, z)
        if found is None:
            raise ScenarioError(
                f"{name} has no room within {REACH:g} m of {x:g}, {z:g}: expected a point inside the arena, away from "
                "others and from obstacles"
            )
        self._happen(_event("place", group=self.scenario.group_names[group], member=member, point=[x, z]))
        return f"{name} is put at {found[0]:.2f}, {found[1]:.2f}."

    def heal(self, avatar: int | None = None) -> None:
        """Restore the health of an avatar, or of all that can be hurt.

        Raises:
            ScenarioError: There is no such avatar, or nothing hurts it.
        """
        if avatar is None:
            self._happen(_event("heal"))
            return
        group, member = self._member(avatar)
        if not self.health()[1][avatar]:
            name = self.crowd.cast.names[avatar]
            raise ScenarioError(f"nothing hurts {name}, expected an avatar whose type has 'damage'")
        self._happen(_event("heal", group=self.scenario.group_names[group], member=member))

    def _come_or_go(self, kind: str, avatar: int) -> None:
        group, member = self._member(avatar)
        if self.crowd.count < 2:
            raise ScenarioError("the only avatar cannot be taken out, expected a scenario with more")
        self._happen(_event(kind, group=self.scenario.group_names[group], member=member))

    def drag(self, target: int, x: float, y: float, z: float) -> None:
        """Let a scripted target be at a point [m] from the next control frame on.

        Raises:
            ScenarioError: There is no such target, or the point is too far away.
        """
        if not 0 <= target < len(self.crowd.targets):
            raise ScenarioError(f"target {target}: expected one of {len(self.crowd.targets)}")
        if self.is_over:
            raise ScenarioError("the scenario has come to its end, nothing can be dragged")
        point = np.array([x, y, z], float)
        if not (np.isfinite(point).all() and np.abs(point[[0, 2]]).max() <= FARTHEST and 0.05 <= y <= HIGHEST):
            raise ScenarioError(
                f"target at {x:g}, {y:g}, {z:g}: expected x and z up to {FARTHEST:g} m, a height up to {HIGHEST:g} m"
            )
        self.simulation.move_target(target, *(round(float(value), 3) for value in point))
        self._dragged.add(target)
        self.is_changed = True

    def _member(self, avatar: int) -> tuple[int, int]:
        """Return the group of an avatar, and its number in it."""
        if not 0 <= avatar < self.crowd.count:
            raise ScenarioError(f"avatar {avatar}: expected a number from 0 to {self.crowd.count - 1}")
        group = int(self.crowd.group[avatar])
        return group, int(np.count_nonzero(self.crowd.group[:avatar] == group))

    def _happen(self, keys: dict[str, Any]) -> None:
        """Let an event happen before the next decisions, and note it."""
        if self.simulation.outcome is not None or self.is_over:
            raise ScenarioError("the scenario has come to its end, nothing can be changed; begin again")
        keys["when"] = {"kind": "frame", "frame": self.simulation.next_change}
        try:
            event = _EVENT.validate_python(keys)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"][1:]))
            raise ScenarioError(f"{where}: {first['msg']}") from None
        # All that is wrong with it shows here, and not when the session is recorded.
        self._changed({"events": (*self.scenario.events, *self._events, event)})
        self.simulation.change(plan_change(self.scenario, self.crowd, event))
        self._events.append(event)
        self.is_changed = True

    # What is kept

    def recorded(self) -> Scenario:
        """Return the scenario that repeats the session up to now.

        Raises:
            ScenarioError: There is nothing to repeat yet.
        """
        frames = self.frame  # which a step in progress may change meanwhile
        if not frames:
            raise ScenarioError("nothing has been simulated yet, expected a control frame or more")
        targets = {
            name: self._target(index, target, frames)
            for index, (name, target) in enumerate(self.scenario.targets.items())
        }
        events = [event for event in self._events if event.when.frame < frames]
        return self._changed({"duration": frames, "targets": targets, "events": (*self.scenario.events, *events)})

    def _target(self, index: int, target: Any, frames: int) -> Any:
        """Return a target as it has been dragged, which is not checked yet."""
        path = self.crowd.targets[index]
        assert isinstance(path, KeyPath)
        if index not in self._dragged:
            return target
        keys = [(frame, *point) for frame, point in zip(path.frames, path.points, strict=True) if frame < frames]
        if not keys:
            return target
        before = target.before if isinstance(target, KeysTarget) else target
        return {"kind": "keys", "keys": keys, "before": None if before is None else before.model_dump()}

    def _changed(self, changes: Mapping[str, Any]) -> Scenario:
        """Return the scenario with other keys, checked as a file is."""
        plain = {
            key: {name: one if isinstance(one, dict) else one.model_dump() for name, one in value.items()}
            if isinstance(value, dict)
            else [one.model_dump() for one in value]
            if isinstance(value, tuple)
            else value
            for key, value in changes.items()
        }
        try:
            checked = Scenario.model_validate(
                {**self.scenario.model_dump(), **plain}, context={"folder": self.scenario.folder}
            )
        except ValidationError as error:
            reasons = [str(detail.get("ctx", {}).get("error", detail["msg"])) for detail in error.errors()]
            raise ScenarioError("; ".join(reasons)) from None
        return self.scenario.model_copy(update={key: getattr(checked, key) for key in changes})

    def keep(self, folder: Path) -> None:
        """Write the scenario that repeats the session as ``scenario.yaml`` into a folder, and the files that it reads.

        Raises:
            ScenarioError: There is nothing to keep yet.
            OSError: It cannot be written.
        """
        text = dump_scenario(self.recorded())
        make_folder(folder)
        for name in self.scenario.files:
            copy_plain(self.scenario.folder / name, folder, PurePosixPath(name).as_posix())
        write_plain(folder, "scenario.yaml", text)

    def record(
        self,
        folder: FileName,
        command: str = "",
        progress: Progress | None = None,
        notify: Callable[[str], None] | None = None,
    ) -> Report:
        """Write the session up to now as a run, which is simulated again from its scenario.

        Args:
            folder: The run folder, which must be new.
            command: The command, for the manifest.
            progress: Called with stage, done and total.
            notify: Called with what a user should know.

        Raises:
            ScenarioError: There is nothing to record yet.
            OutputError: The folder cannot be used.
            RunError: It cannot be written, or the run differs from the session.
        """
        from crowdsim.runs.runner import run_to
        from crowdsim.take.store import open_take

        scenario, digest = self.recorded(), self._digest.hexdigest()
        report = run_to(folder, scenario, self._threads, None, False, command, progress, notify, self.policies)
        take, again = open_take(Path(folder) / "take.zarr"), hashlib.sha256()
        columns = {name: np.asarray(getattr(take, name)[:]) for name in (*VARIABLES, "targets")}
        for row in range(take.frame_count):
            for values in columns.values():
                again.update(np.ascontiguousarray(values[row]).tobytes())
        if again.hexdigest() != digest:
            raise RunError(f"{folder}: the run that repeats the session differs from it")
        self.is_changed = False
        return report


def _event(kind: str, **keys: Any) -> dict[str, Any]:
    """Return the keys of an event in the first control frame."""
    return {"kind": kind, "when": {"kind": "frame", "frame": 0}, **keys}
