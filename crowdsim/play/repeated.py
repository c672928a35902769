"""Why avatars of a run did what they did: the run is simulated again up to their decisions."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from crowdsim import assets
from crowdsim.core.types import Array
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.explaining import Decision
from crowdsim.crowd.jit_warmup import warm_up
from crowdsim.crowd.simulation import Simulation
from crowdsim.errors import TakeError
from crowdsim.runs.folder import RESOLVED, place_of
from crowdsim.runs.recorded import RecordedRun
from crowdsim.scenario.scenario import load_scenario
from crowdsim.view.why import describe_decision, describe_values

_BACK = 600
"""How far a decision may lie back [control frames]."""


class Repeated:
    """A run that is simulated again, as far as it is asked about.

    Args:
        run: The run, in its folder.
        threads: Threads; results do not depend on them.

    Raises:
        TakeError: The run has no folder.
        ScenarioError: Its scenario cannot be read.
    """

    def __init__(self, run: RecordedRun, threads: int = 1) -> None:
        if run.folder is None:
            raise TakeError("the run is in memory, expected one in a folder with its scenario")
        self._run, self._threads, self._lock = run, threads, threading.Lock()
        known = {*assets.policy_names(), *run.cast.policy_names}
        self._scenario = load_scenario(place_of(run.folder) / RESOLVED, policies=known)
        self._simulation: Simulation | None = None
        # The frame whose values were asked about last, and the state in which its decisions are made.
        self._kept: tuple[int, dict[str, Array]] | None = None

    def at(self, avatar: int, frame: int) -> dict[str, Any]:
        """Return an avatar's last decision up to a control frame as plain data, see ``describe_decision``.

        Raises:
            TakeError: There is no such avatar or frame, it has not decided before, or the run cannot be repeated.
        """
        run = self._run
        if not 0 <= avatar < run.avatar_count or not 0 <= frame < run.frame_count:
            raise TakeError(f"avatar {avatar} at control frame {frame}: is not in the run")
        with self._lock:
            when = self._decided(avatar, frame)
            found = next((one for one in self._decisions(when) if one.avatar == avatar), None)
        if found is None:
            raise TakeError(f"{run.cast.names[avatar]} decides nothing at control frame {frame}")
        return self._describe(found)

    def values(self, avatar: int, frame: int) -> dict[str, Any]:
        """Return an avatar's value map in a control frame as plain data, see ``describe_values``.

        Raises:
            TakeError: There is no such avatar or frame, or the run cannot be repeated.
        """
        run = self._run
        if not 0 <= avatar < run.avatar_count or not 0 <= frame < run.frame_count:
            raise TakeError(f"avatar {avatar} at control frame {frame}: is not in the run")
        with self._lock:
            simulation = self._simulated(frame)
            self._kept = frame, simulation.state()
            simulation.run(1)
            found = simulation.value_map(avatar)
            if found is not None:
                slot = int(simulation.avatars.slot_of[avatar])
                base = int(simulation.model.policies["actions"][simulation.avatars.policy[slot]])
                self._check(avatar, frame, int(simulation.avatars.motion["action"][slot]) - base)
        return describe_values(found, avatar, frame)

    def all(self, avatars: Sequence[int], first: int, stop: int) -> Iterator[dict[str, Any]]:
        """Yield the decisions of avatars in control frames ``first`` to ``stop``, and the last ones before.

        Raises:
            TakeError: The run cannot be repeated.
        """
        begin = min((self._decided(avatar, first, 0) for avatar in avatars), default=first)
        for frame in range(begin, stop):
            for one in self._decisions(frame):
                if one.avatar in avatars:
                    yield self._describe(one)

    def _describe(self, decision: Decision) -> dict[str, Any]:
        self._check(decision.avatar, decision.frame, decision.chosen)
        return describe_decision(decision, self._run.policies[self._run.cast.policies[decision.avatar]])

    def _check(self, avatar: int, frame: int, action: int) -> None:
        """Refuse to go on where an avatar does something else than it did in the run."""
        if int(self._run.action[frame : frame + 1][0, avatar]) != action:
            raise TakeError(
                f"{self._run.folder}: the run cannot be repeated here, it was made with other versions or policies"
            )

    def _decided(self, avatar: int, frame: int, none: int | None = None) -> int:
        """Return the control frame of an avatar's last decision up to one; ``none``, or an error, without one."""
        run, low = self._run, max(0, frame - _BACK)
        action = np.asarray(run.action[low : frame + 1])[:, avatar]
        phase = np.asarray(run.action_frame[low : frame + 1])[:, avatar]
        fresh = action[1:] != action[:-1]
        fresh |= phase[1:] < phase[:-1] + 0.5 * run.cast.speeds[avatar]
        at = np.flatnonzero(fresh & (action[1:] >= 0))
        if len(at):
            return low + 1 + int(at[-1])
        if none is not None:
            return none
        raise TakeError(f"{run.cast.names[avatar]} has decided nothing up to control frame {frame}")

    def _decisions(self, frame: int) -> list[Decision]:
        """Return the decisions of a control frame."""
        return self._simulated(frame).explain()

    def _simulated(self, frame: int) -> Simulation:
        """Return the simulation after ``frame`` control frames."""
        simulation = self._simulation
        if simulation is not None and self._kept is not None and self._kept[0] <= frame < simulation.frame:
            simulation.restore(self._kept[1])
        if simulation is None or simulation.frame > frame:
            if simulation is not None:
                simulation.close()
            crowd = draw_crowd(self._scenario, self._run.policies)
            search = self._scenario.opponents.search
            simulation = Simulation(crowd, self._threads, search, model=warm_up(crowd, search))
            self._simulation, self._kept = simulation, None
        if simulation.frame < frame:
            simulation.run(frame - simulation.frame)
        return simulation
