"""The simulation: a crowd is run control frame by control frame and yields chunks of plain arrays.

At every frame those whose action has ended observe and choose, all from the state at that frame; then the frame is
recorded, and all move on. A small crowd runs many frames in one compiled call; a large one goes stage by stage, each
stage shared out among threads. Both give the same bytes, for any number of threads and any order of storage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Arena, Avatars, CrowdingRules, Model, Record, Streams, World
from crowdsim.crowd.attachments import shield_radii
from crowdsim.crowd.buffers import empty_record, empty_scratch, empty_strikes
from crowdsim.crowd.chunk import STAGES, Chunk, Frame, events_of
from crowdsim.crowd.cohorts import cohort_columns
from crowdsim.crowd.crowd import Crowd, build_avatars, enter
from crowdsim.crowd.cuda.device import choose_device
from crowdsim.crowd.entering import (
    AGAIN,
    Arrival,
    describe_arrivals,
    entries_of,
    entry_points,
    find_entries,
    find_place,
    first_in_line,
)
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.confinement import confine_all
from crowdsim.crowd.kernels.layout import Now
from crowdsim.crowd.kernels.loop import run_frames
from crowdsim.crowd.kernels.records import COHORT, RULE, records
from crowdsim.crowd.model import build_model
from crowdsim.crowd.opponents import Index, build_index
from crowdsim.crowd.outcome import Outcome, find_outcome
from crowdsim.crowd.pre_roll import on_guard, take_over
from crowdsim.crowd.progress import LED_EVERY, Agenda, Progress
from crowdsim.crowd.random import Purpose, stream
from crowdsim.crowd.script import Change, KeyPath, seen_targets, target_positions
from crowdsim.crowd.stages import Stages, lost_avatar
from crowdsim.crowd.state import read_state, write_state
from crowdsim.crowd.travelling import defend_travellers, halt, headings_of, set_out, travel_on
from crowdsim.crowd.triggers import AtFrame, Ended
from crowdsim.crowd.workers import Workers
from crowdsim.errors import RunError, nearest
from crowdsim.places.arrays import build_places
from crowdsim.scenario.groups import SEARCHES

if TYPE_CHECKING:
    from crowdsim.crowd.cuda.stages import CudaStages
    from crowdsim.crowd.explaining import Decision
    from crowdsim.crowd.value_map import ValueMap

SMALL = 400
"""Most avatars whose opponents ``auto`` finds by comparing with everyone, many frames in one compiled call."""


def crowd_model(crowd: Crowd) -> Model:
    """Return the policies of a crowd one after another, with what its avatars need of them."""
    model = build_model(crowd.policies, bool(crowd.cast.stances.any()), bool(len(crowd.parts)))
    if not crowd.cast.held["blocks"].any():
        return model
    shields = np.zeros((crowd.count, 4), np.float32)
    for index, policy in enumerate(crowd.policies):
        mine = np.flatnonzero(crowd.cast.policies == index)
        shields[mine] = shield_radii(crowd.cast, mine, policy.database.body)
    return model._replace(shields=shields)


class Simulation:
    """A crowd in motion; ``step`` runs the next control frame, ``run`` many at once, and a loop over it all of them.

    Args:
        crowd: The crowd.
        threads: Threads for large crowds.
        search: How nearest opponents are found, one of ``scenario.groups.SEARCHES``.
        order: Number of the avatar in each slot at the start; it changes no result. Shape (N,).
        profiled: Take the time of every stage.
        model: Arrays of the crowd's policies; built when None.
        device: Where control runs, one of ``cuda.device.DEVICES``; it changes no result.
        compiling: Called with stage, done and total while kernels are compiled for a GPU.

    Attributes:
        searches: What has found them so far, in this order: ``direct``, ``kd_tree`` or ``scipy``. With ``auto`` it is
            ``direct`` in frames with up to ``SMALL`` avatars, the tree in others. A GPU always searches its tree, and
            notes what the processor would have done, so that their checkpoints are equal.

    Raises:
        RunError: The policies do not go together, the crowd has none or weights of fewer behaviours than one has, a
            position is not finite, or ``search`` is unknown.
        DeviceError: ``device`` is unknown or missing, or cannot search like that.
    """

    def __init__(
        self,
        crowd: Crowd,
        threads: int = 1,
        search: str = "auto",
        order: Array | None = None,
        profiled: bool = False,
        model: Model | None = None,
        device: str = "cpu",
        compiling: Callable[[str, int, int], None] | None = None,
    ) -> None:
        if not isinstance(crowd, Crowd) or not len(crowd.policies):
            what = "a crowd without policies" if isinstance(crowd, Crowd) else f"a {type(crowd).__name__}"
            raise RunError(f"cannot simulate {what}, expected one of crowdsim.draw_crowd(scenario, policies)")
        if search not in SEARCHES:
            raise RunError(f"search is {search!r}, expected one of {', '.join(SEARCHES)}{nearest(search, SEARCHES)}")
        most = max(len(policy.behaviours) for policy in crowd.policies)
        if crowd.weights.shape[1] < most:
            raise RunError(
                f"crowd has weights of {crowd.weights.shape[1]} behaviours, expected {most} as policies have"
            )
        self.crowd = crowd
        self.model = crowd_model(crowd) if model is None else model
        self.avatars: Avatars = build_avatars(crowd, self.model, order)
        self.present = int(np.count_nonzero(crowd.present))
        self.frame = 0
        # The frame whose changes have been made.
        self._changed_at = -1
        self.rate = crowd.rate
        self.outcome: Outcome | None = None
        self._workers = Workers(threads)
        self._search = search
        self._gpu: CudaStages | None = None
        self._index: Index
        self._stages: Stages | CudaStages
        self.device = choose_device(device, crowd.count, search)
        if self.device == "cuda":
            from crowdsim.crowd.cuda.stages import CudaStages, SortingIndex

            index = SortingIndex(self._workers)
            self._gpu = CudaStages(crowd, self.model, self.avatars, index, self._workers, compiling)
            self._index, self._stages = index, self._gpu
        else:
            self._index = build_index(search, self._workers)
            self._stages = Stages(crowd, self.model, self.avatars, self._index, self._workers)
        self.searches: list[str] = []
        self._profiled = profiled
        self._fresh = np.arange(self.present, dtype=np.int32)
        # Where a target that is dragged goes is known one frame at a time.
        self._follows_keys = any(isinstance(path, KeyPath) for path in crowd.targets)
        self._lingers = 0 if crowd.until is None else round(crowd.until.lingers * self.rate)
        self._scratch = empty_scratch(self.model, crowd.crowding.most, min(SMALL, max(crowd.count, 1)))
        self._world = World(
            weights=np.array(crowd.weights, dtype=float),
            cohorts=records(np.column_stack(cohort_columns(crowd)), COHORT),
            rules=records(crowd.rules, RULE) if len(crowd.rules) else np.zeros(len(crowd.weights), RULE),
            pauses=np.zeros(1),
            arena=Arena(*map(float, crowd.arena)),
            places=build_places(crowd.parts),
            crowding=CrowdingRules(*map(float, crowd.crowding.numbers())),
            targets=np.zeros((2, 0, 3)),
            streams=Streams(*(np.uint64(stream(crowd.seed, one)) for one in (Purpose.CHOICE, Purpose.BURST))),
        )
        self._agenda = Agenda(crowd, Progress(crowd, self.avatars, self._world))
        if crowd.pre_roll and self.present:
            with Simulation(on_guard(crowd), threads, search, model=self.model, device=self.device) as rolled:
                rolled.avatars.fight["rested"] = np.inf  # strikes cost everyone as much as after a burst
                rolled.run(crowd.pre_roll)
                rolled.fetch()
            self._fresh = take_over(self.avatars, rolled.avatars, self.present)
        if len(crowd.parts):
            confine_all(self.model, self.avatars, self._world, 0, self.present)

    @property
    def nbytes(self) -> int:
        """Memory of the avatars and of one recorded frame, beside the policies."""
        avatars = sum(values.nbytes for values in self.avatars) + self._stages.nbytes
        return avatars + 24 * self.crowd.count + getattr(self._index, "nbytes", 0)

    @property
    def next_change(self) -> int:
        """The first control frame whose changes have not been made yet."""
        return self.frame + (self._changed_at == self.frame)

    def change(self, change: Change) -> None:
        """Let a change happen that was not planned; with it planned, the run would be the same.

        Raises:
            RunError: The change waits for a control frame whose changes have been made already.
        """
        if not isinstance(change.when, AtFrame) or change.when.frame < self.next_change:
            raise RunError(
                f"a change at {change.when} comes too late, expected control frame {self.next_change} or later"
            )
        self.crowd = replace(self.crowd, changes=(*self.crowd.changes, change))
        self._agenda.add(change)

    def move_target(self, number: int, x: float, y: float, z: float) -> int:
        """Let a scripted target be somewhere from the next control frame on, and return that frame.

        Args:
            number: Number of the target, whose path is a ``script.KeyPath``.
            x: Where it is [m].
            y: Its height [m].
            z: Where it is [m].

        Raises:
            RunError: There is no such target, or its path is fixed.
        """
        path = self.crowd.targets[number] if 0 <= number < len(self.crowd.targets) else None
        if not isinstance(path, KeyPath):
            raise RunError(f"target {number} cannot be moved, expected one whose path has keys")
        path.add(self.frame, (x, y, z))
        return self.frame

    def fetch(self) -> None:
        """Make ``avatars`` valid, which are elsewhere between frames on a GPU; they may be changed then."""
        if self._gpu is not None:
            self._gpu.fetch()

    def explain(self) -> list[Decision]:
        """Return the decisions of the next control frame, in the order of avatars, without going on."""
        from crowdsim.crowd.explaining import explain_frame

        if self.is_over:
            return []
        self._apply_events()
        self.fetch()
        world, moves = self._world_at(self.frame - 1, 2), not self._is_rolled_in
        return explain_frame(self.crowd, self.model, self.avatars, world, self._now, self._fresh, moves)

    def value_map(self, number: int) -> ValueMap | None:
        """Return what an avatar's next action is worth by where its opponent stands; None where it decides nothing.

        Raises:
            ValueError: There is no such avatar.
        """
        from crowdsim.crowd.value_map import map_values

        if not 0 <= number < self.crowd.count:
            raise ValueError(f"avatar {number} is not in the crowd, expected 0 to {self.crowd.count - 1}")
        self.fetch()
        if self.avatars.slot_of[number] >= self.present:
            return None
        return map_values(self.crowd, self.model, self.avatars, self._world_at(self.frame, 2), number)

    @property
    def _now(self) -> Now:
        return Now(self.frame, 1, self.present)

    def state(self) -> dict[str, Array]:
        """Return all that decides how the simulation goes on, see ``state.read_state``."""
        self.fetch()
        return read_state(self)

    def restore(self, state: Mapping[str, Array]) -> None:
        """Go on from a state of the same crowd, policies and script, see ``state.write_state``.

        Raises:
            ValueError: The state is of another crowd.
        """
        self.fetch()
        write_state(self, state)

    def arrivals_text(self) -> str:
        """Return in a sentence which avatars had no room where they were added or put; nothing where all had."""
        return describe_arrivals(
            self._agenda.arrivals,
            self._agenda.waiting,
            self._agenda.places,
            self.frame,
            self.rate,
            self.crowd.cast.names,
        )

    @property
    def is_over(self) -> bool:
        """Whether the run has come to its planned duration, or has lingered as long as planned after its end."""
        ends = self.outcome is not None and self.frame >= self.outcome.frame + self._lingers
        return ends or self.frame >= self.crowd.frames

    def close(self) -> None:
        """End the threads."""
        self._workers.close()

    def __enter__(self) -> Simulation:
        """Return the simulation, whose threads end with the context."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the threads."""
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        """Run and yield one control frame after another, until the run is over."""
        while (chunk := self.run(1)).frames:
            yield chunk.frame(0)

    def step(self) -> Frame:
        """Run the next control frame and return it; it is the same whatever else is run in one call.

        Raises:
            RunError: The run is over (``is_over``), or an avatar's position or values are not finite.
        """
        chunk = self.run(1)
        if not chunk.frames:
            raise RunError(
                f"the run is over after {self.frame} control frames, expected no step where 'is_over' is true; "
                "a scenario with more frames, and without 'until', goes on"
            )
        if not self.is_over:
            # Events of the next frame may end the run before it, which is known from now on.
            self._apply_events()
        return chunk.frame(0)

    def run(self, frames: int) -> Chunk:
        """Run the next ``frames`` control frames and return them; fewer where the run comes to its end before.

        Raises:
            RunError: An avatar's position or values are not finite; the message names avatar and frame.
        """
        first, count = self.frame, self.crowd.count
        frames = min(frames, max(self.crowd.frames - first, 0))
        record = empty_record(frames, count)
        timings = np.zeros((frames if self._profiled else 0, len(STAGES)), np.int64)
        strikes = []
        done = 0
        while done < frames and not self.is_over:
            self._apply_events()
            if self.is_over:
                break
            if self.present < count:
                self._blank(record, done, frames)
            most = frames - done
            if self.outcome is not None:
                most = min(most, self.outcome.frame + self._lingers - self.frame)
            step = 1 if self._follows_keys else self._agenda.until_next(self.frame, most)
            rows = record.rows(done, done + step)
            times = timings[done : done + step]
            if self.present <= SMALL and self._search == "auto":
                ran, thrown = self._run_small(rows, times)
            else:
                ran, thrown = self._run_stages(rows, times)
            strikes.append(thrown)
            self._agenda.progress.count(thrown)
            if self.crowd.travels:
                defend_travellers(self.crowd, self.avatars, thrown)
            done += ran
        record = record.rows(0, done)
        targets = target_positions(self.crowd.targets, first, done, self.rate)
        return Chunk(
            first=first,
            **record._asdict(),
            targets=targets.astype(np.float32),
            events=events_of(strikes or [empty_strikes(0)]),
            timings=timings[:done] if self._profiled else None,
        )

    def _run_small(self, rows: Record, timings: Array) -> tuple[int, Array]:
        """Run as many frames as there are rows, or as there is room for strikes, in one compiled call."""
        frames, present = len(rows.action), self.present
        fresh, still = self._fresh, self._is_rolled_in or len(self._fresh) == present
        if len(fresh) and not still:
            # Avatars that have just entered decide before the others move.
            return self._run_stages(rows.rows(0, 1), timings[:1])
        self._note_search("direct")
        if self._gpu is not None:
            return self._run_frame(rows.rows(0, 1), timings[:1])
        world = self._world_at(self.frame - 1, frames + 1)
        strikes = empty_strikes(16 * present + present * frames // 2)
        ran, held, lost = run_frames(
            self.model, self.avatars, world, self._now, frames, still, fresh, self._scratch, rows, strikes, timings
        )
        if lost >= 0:
            raise lost_avatar(self.avatars, lost, self.frame + ran)
        self._fresh = self._fresh[:0]
        self.frame += ran
        return int(ran), strikes[:held]

    def _run_stages(self, rows: Record, timings: Array) -> tuple[int, Array]:
        """Run one frame, each stage shared out among threads."""
        self._note_search("scipy" if self._search == "scipy" else "kd_tree")
        return self._run_frame(rows, timings)

    def _run_frame(self, rows: Record, timings: Array) -> tuple[int, Array]:
        """Run one frame stage by stage."""
        fresh, self._fresh = self._fresh, self._fresh[:0]
        world, moves = self._world_at(self.frame - 1, 2), not self._is_rolled_in
        thrown = self._stages.run(world, self._now, fresh, rows, timings, moves)
        self.frame += 1
        return 1, thrown

    @property
    def _is_rolled_in(self) -> bool:
        """Whether the next frame is the first one after a pre-roll, which is recorded before any avatar moves."""
        return self.frame == 0 and self.crowd.pre_roll > 0

    def _note_search(self, search: str) -> None:
        if search not in self.searches:
            self.searches.append(search)

    def _world_at(self, first: int, frames: int) -> World:
        if not self.crowd.targets:
            return self._world._replace(targets=np.zeros((frames, 0, 3)))
        seen = seen_targets(self.crowd.targets, first, frames, frames + layout.FORESEEN, self.rate)
        return self._world._replace(targets=seen)

    def _blank(self, record: Record, first: int, last: int) -> None:
        """Mark avatars as absent in the record; those that are present write over it."""
        absent = record.rows(first, last)
        absent.action[:], absent.opponent[:], absent.action_frame[:] = -1, -1, 0.0
        absent.x[:], absent.z[:], absent.heading[:] = np.nan, np.nan, np.nan

    def _apply_events(self) -> None:
        """Make changes whose time has come, before this frame's decisions, and only once in a frame."""
        if self._changed_at == self.frame:
            return
        self._changed_at = self.frame
        progress = self._agenda.progress
        if len(self.avatars.conditions) or not self._agenda.is_quiet(self.frame):
            self.fetch()
        progress.frame, progress.present, progress.ended = self.frame, self.present, self.outcome is not None
        if len(self.avatars.conditions):
            # Those leave that are out and whose policies have no falls.
            leave = self.avatars.conditions["standing"][self.avatars.number] == layout.OUT
            if leave[: self.present].any():
                self._leave(leave)
                self._index.reset()
            if self.crowd.travels and self.frame % LED_EVERY == 0:
                self._travel()
        is_time = self._agenda.expect(self.frame) or self.frame % AGAIN == 0
        if self._agenda.waiting and is_time:
            self._enter()
        for change in self._agenda.due():
            self._apply(change)
        progress.present = self.present
        if self.crowd.until is not None and self.outcome is None:
            self.outcome = find_outcome(self.crowd.until, self._agenda, self.crowd)
            progress.ended = self.outcome is not None
            for change in self._agenda.due(Ended):
                self._apply(change)
        for change in self._agenda.retiring():
            self._set_out(change)
        self._world.pauses[0] = float(self._agenda.waits_for_strikes)

    def _apply(self, change: Change) -> None:
        for values, new in (
            (self._world.weights, change.weights),
            (self._world.cohorts["temperature"], change.temperatures),
            (self._world.cohorts["interval"], change.intervals),
            (self._world.cohorts["reaction"], change.reactions),
            (self._world.cohorts["hysteresis"], change.hysteresis),
            (self._world.cohorts["defence"], change.defences),
            (self._world.rules["attackers"], change.attackers),
        ):
            if new is not None:
                np.copyto(values, new, where=~np.isnan(new))
        if change.who is None:
            return
        concerned = change.who[self.avatars.number]
        if change.skip is not None and change.fixed is not None:
            numbers = self.avatars.number[concerned]
            self.avatars.skip[concerned] = change.skip[numbers]
            self.avatars.fixed[concerned] = change.fixed[numbers]
        if change.mode is not None:
            self.avatars.conditions["mode"][change.who] = change.mode
            self.avatars.conditions["since"][change.who] = self.frame
            self.avatars.conditions["keeps"][change.who] = change.distance
            self.avatars.conditions["travel"][change.who] = self.avatars.conditions["leg"][change.who] = 0.0
        if change.travel is not None and change.health_below is None:
            numbers = np.flatnonzero(change.who).tolist()
            self._agenda.forget(number for number in numbers if number not in self._agenda.places)
            self._set_out(change)
        if change.heals:
            self._heal(change.who)
        if change.point is not None:
            self._take_up(concerned, change.point)
        if change.present:
            self._add(np.sort(self.avatars.number[self.present :][concerned[self.present :]]))
        elif change.present is not None:
            self._agenda.forget(np.flatnonzero(change.who).tolist())
            self._leave(concerned)
        self._index.reset()

    def _add(self, numbers: Array) -> None:
        """Let absent avatars enter, those along a path one after another."""
        agenda, entries = self._agenda, entries_of(self.crowd, numbers)
        counts = dict.fromkeys(entries.tolist(), 0)
        for number, entry in zip(numbers.tolist(), entries.tolist(), strict=True):
            if number in agenda.waiting or number in agenda.expected:
                continue
            after = int(counts[entry] * self.crowd.travels[entry].interval) if entry >= 0 else 0
            counts[entry] += 1
            agenda.expected[number] = self.frame + after
        agenda.expect(self.frame)
        self._enter()

    def _set_out(self, change: Change) -> None:
        """Let avatars go away that are there or put elsewhere, not down for good, and hurt where that counts."""
        assert change.travel is not None
        assert change.who is not None
        conditions = self.avatars.conditions
        goes = change.who & ~self._agenda.progress.out
        absent = self.avatars.number[self.present :]
        goes[absent] &= np.isin(absent, list(self._agenda.places))
        goes &= (conditions["mode"] != layout.TRAVELS) | (conditions["travel"] != change.travel + 1)
        if change.health_below is not None:
            goes &= conditions["health"] < change.health_below
        set_out(self.crowd, self.avatars, np.flatnonzero(goes), change.travel, 0)

    def _travel(self) -> None:
        """Lead avatars on that travel; those leave that have come to the end of their way."""
        halt(self.avatars, np.flatnonzero(self._agenda.progress.out & (self.avatars.conditions["travel"] > 0)))
        leaving = travel_on(self.crowd, self.avatars, self.present)
        if len(leaving):
            self._leave(np.isin(self.avatars.number, leaving))
            self._index.reset()

    def _heal(self, who: Array) -> None:
        """Restore the health of avatars (N,) that are there."""
        conditions, rules = self.avatars.conditions, self._world.rules[self.crowd.cohort]
        healed = who & self._agenda.progress.here
        for name, values in (("health", rules["full_health"]), ("stamina", 1.0), ("hurt", 0.0), ("downs", 0.0)):
            conditions[name] = np.where(healed, values, conditions[name])
        stays = healed & (conditions["standing"] >= layout.FALLING) & np.isposinf(conditions["rises"])
        conditions["rises"] = np.where(stays, self.frame + rules["down_frames"], conditions["rises"])

    def find_place(self, number: int, x: float, z: float) -> Array | None:
        """Return where an avatar would be put now that is moved to a point [m], see ``entering.find_place``."""
        self.fetch()
        point = np.array([x, z])
        return find_place(self.crowd, self._world.places, self.avatars, self.present, number, point, self.frame)

    def _take_up(self, concerned: Array, point: tuple[float, float]) -> None:
        """Take an avatar that is there and up out of the scene, to be put at a point in the next control frame."""
        there = concerned & (np.arange(self.crowd.count) < self.present) & (self.avatars.team >= 0)
        for slot in np.flatnonzero(there).tolist():
            number = int(self.avatars.number[slot])
            self._agenda.places[number] = (*point, float(self.avatars.heading[slot]))
            self._agenda.expected[number] = self.frame + 1
        if there.any():
            self._leave(there)

    def _put_down(self) -> None:
        """Put avatars that were taken up where there is room, in the health and on the journey that they had."""
        agenda = self._agenda
        for number in sorted(agenda.waiting.keys() & agenda.places.keys()):
            x, z, heading = agenda.places[number]
            at = self.find_place(number, x, z)
            if at is None:
                continue
            asked, away = agenda.waiting.pop(number), float(np.hypot(at[0] - x, at[1] - z))
            if away > 0.0 or asked < self.frame:
                agenda.arrivals.append(Arrival(number, asked, self.frame, away, is_put=True))
            del agenda.places[number]
            kept = self.avatars.conditions[[number]] if len(self.avatars.conditions) else None
            now = np.arange(self.crowd.count) < self.present
            now[self.avatars.slot_of[number]] = True
            self._store(now, [number])
            enter(self.avatars, self.crowd, self.model, self.avatars.slot_of[[number]], at[None], np.array([heading]))
            if kept is not None:
                for name in ("health", "stamina", "hurt", "hurt_frame", "downs", "mode", "travel", "leg"):
                    self.avatars.conditions[name][number] = kept[name][0]
            self._index.reset()

    def _enter(self) -> None:
        """Let avatars enter that wait, where they have room."""
        agenda = self._agenda
        self._put_down()
        numbers = first_in_line(self.crowd, {n: at for n, at in agenda.waiting.items() if n not in agenda.places})
        if not len(numbers):
            return
        at = find_entries(self.crowd, self.avatars, self.present, numbers)
        room = np.isfinite(at[:, 0])
        if not room.any():
            return
        numbers, at = numbers[room], at[room]
        for number, (x, z), placed in zip(numbers.tolist(), at, entry_points(self.crowd, numbers), strict=True):
            asked, away = agenda.waiting.pop(number), np.hypot(x - placed[0], z - placed[1])
            if away > 0.0 or asked < self.frame:
                agenda.arrivals.append(Arrival(number, asked, self.frame, float(away)))
        now = np.arange(self.crowd.count) < self.present
        now[self.avatars.slot_of[numbers]] = True
        self._store(now, numbers)
        slots, headings = self.avatars.slot_of[numbers], headings_of(self.crowd, numbers)
        entries = entries_of(self.crowd, numbers)
        for entry in np.unique(entries).tolist():
            own = entries == entry
            enter(self.avatars, self.crowd, self.model, slots[own], at[own], headings[own], is_calm=entry >= 0)
            if entry >= 0:
                set_out(self.crowd, self.avatars, numbers[own], entry, 1)
        self._index.reset()

    def _leave(self, concerned: Array) -> None:
        """Let the avatars of some slots leave."""
        self._store((np.arange(self.crowd.count) < self.present) & ~concerned)

    def _store(self, now: Array, entering: Array | Sequence[int] = ()) -> None:
        """Store the avatars of some slots (N,) first, which are there from now on; some of them enter."""
        from crowdsim.crowd.opponents import store_in_order

        fresh = np.append(self.avatars.number[self._fresh], np.asarray(entering, np.int64))
        store_in_order(self.avatars, np.argsort(~now, kind="stable"), self._workers)
        self.present = int(np.count_nonzero(now))
        slots = self.avatars.slot_of[fresh]
        self._fresh = np.unique(slots[slots < self.present]).astype(np.int32)
