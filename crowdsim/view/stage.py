"""What is played live: a thread that simulates at the control rate, those who watch, and what they do."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from crowdsim.core.types import Array
from crowdsim.crowd.chunk import Frame
from crowdsim.errors import CrowdsimError, ScenarioError
from crowdsim.view.live import LAG, LivePoses, Played, clips_of, live_recording, pack_frame
from crowdsim.view.why import describe_decision, describe_values

BACKLOG = 0.25
"""How far behind time a session may be to catch up without a jump; pages smooth that [s]."""
TURN = 0.001
"""For how long a session that is late lets others go before it [s]."""
Send = Callable[[str | bytes], None]
"""Sends a message to one who watches; called by any thread."""
_ENDING = 0.5
"""How long a step in progress is waited for at the end [s]."""


class Passing(str):
    """A message that one who cannot keep up may miss, as frames are: newer ones follow it."""

    __slots__ = ()


class _Command(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Pause(_Command):
    """Stop the simulation, or let it go on."""

    do: Literal["pause"]
    paused: bool

    def apply(self, stage: Stage) -> None:
        """Do it."""
        stage.pause(self.paused)


class Step(_Command):
    """Simulate one control frame."""

    do: Literal["step"]

    def apply(self, stage: Stage) -> None:
        """Do it."""
        stage.pause(True)
        stage.advance()


class Speed(_Command):
    """Simulate slower or faster than time passes."""

    do: Literal["speed"]
    speed: float = Field(ge=0.1, le=4)

    def apply(self, stage: Stage) -> None:
        """Do it."""
        stage.speed = self.speed


class Restart(_Command):
    """Begin again."""

    do: Literal["restart"]

    def apply(self, stage: Stage) -> str:
        """Do it, and return what is kept."""
        return stage.restart()


class Tune(_Command):
    """Change a weight, the temperature, tempo or time to react of a type."""

    do: Literal["tune"]
    type: str
    key: str
    value: float

    def apply(self, stage: Stage) -> None:
        """Do it."""
        stage.played.tune(self.type, self.key, self.value)


class SetOn(_Command):
    """Set an avatar on another one; without an opponent it fights those of its group again."""

    do: Literal["set_on"]
    avatar: int
    opponent: int | None = None

    def apply(self, stage: Stage) -> None:
        """Do it."""
        stage.played.set_on(self.avatar, self.opponent)


class Remove(_Command):
    """Take an avatar out of the scene."""

    do: Literal["remove"]
    avatar: int

    def apply(self, stage: Stage) -> None:
        """Do it."""
        stage.played.remove(self.avatar)


class Add(_Command):
    """Let an avatar come back that has been taken out."""

    do: Literal["add"]
    avatar: int

    def apply(self, stage: Stage) -> None:
        """Do it."""
        stage.played.add(self.avatar)


class Drag(_Command):
    """Let a target be somewhere else."""

    do: Literal["drag"]
    target: int
    x: float
    y: float
    z: float

    def apply(self, stage: Stage) -> None:
        """Do it."""
        stage.played.drag(self.target, self.x, self.y, self.z)


class Place(_Command):
    """Put an avatar somewhere else."""

    do: Literal["place"]
    avatar: int
    x: float
    z: float

    def apply(self, stage: Stage) -> str:
        """Do it, and return where it is put."""
        return stage.played.place(self.avatar, self.x, self.z)


class Heal(_Command):
    """Restore the health of an avatar, or of all."""

    do: Literal["heal"]
    avatar: int | None = None

    def apply(self, stage: Stage) -> None:
        """Do it."""
        stage.played.heal(self.avatar)


class Why(_Command):
    """Send the decisions of an avatar from now on to the one who asks; without an avatar send none."""

    do: Literal["why"]
    avatar: int | None = None


class Values(_Command):
    """Send the value maps of an avatar from now on to the one who asks; without an avatar send none."""

    do: Literal["values"]
    avatar: int | None = None


class Record(_Command):
    """Write what has been played as a run."""

    do: Literal["record"]

    def apply(self, stage: Stage) -> str:
        """Do it, and return what was written."""
        return stage.record()


_COMMANDS: TypeAdapter[Any] = TypeAdapter(
    Annotated[
        Pause | Step | Speed | Restart | Tune | SetOn | Remove | Add | Drag | Place | Heal | Why | Values | Record,
        Field(discriminator="do"),
    ]
)


class Stage:
    """A session that is shown while it is simulated; it stands still while nobody watches.

    Args:
        played: The session.
        record: Writes the session as a run, and returns a sentence on it.
        keep: Keeps what was done and not recorded before it begins again, and returns a sentence on that.

    Attributes:
        played: The session.
        paused: Whether it stands still.
        speed: How much faster than time passes it is simulated.
    """

    def __init__(self, played: Played, record: Callable[[], str], keep: Callable[[], str] = str) -> None:
        self.played, self.record, self._keep = played, record, keep
        self.paused, self.speed = False, 1.0
        self._lock = threading.RLock()
        # The avatars whose decisions and values each of those who watch asks about.
        self._sends: dict[Send, dict[str, int | None]] = {}
        self._ended, self._woken = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self._begin()

    def _begin(self) -> None:
        rules = self.played.scenario.reactions, self.played.scenario.collision_avoidance
        self._poses = LivePoses(self.played.crowd, *rules)
        self._recording = live_recording(self.played)
        self._states: deque[tuple[Array, Array]] = deque(maxlen=LAG + 1)
        self._last: bytes | None = None
        # The first frames, so that there is something to see, also where it stands still.
        while self._last is None and not self.played.is_over:
            self.advance()

    @property
    def name(self) -> str:
        """Name of what is played."""
        return self.played.scenario.name

    def scene(self) -> bytes:
        """Return what the player shows beside motion, packed."""
        with self._lock:
            return self._recording.scene()

    def start(self) -> None:
        """Begin to simulate."""
        self._thread = threading.Thread(target=self._run, name="stage", daemon=True)
        self._thread.start()

    def close(self) -> bool:
        """Stop for good; return whether the step in progress has ended, which is waited for a moment."""
        self._ended.set()
        self._woken.set()
        if self._thread is None:
            return True
        self._thread.join(_ENDING)
        return not self._thread.is_alive()

    def watch(self, send: Send) -> None:
        """Send messages to someone from now on, first what is to be seen now."""
        if not self._hold(lambda: False):
            return
        try:
            self._sends[send] = {}
            if self._last is not None:
                send(self._last)
            send(json.dumps(self._status()))
        finally:
            self._lock.release()
        self._woken.set()

    def _hold(self, has_left: Callable[[], bool]) -> bool:
        """Take the lock after the step in progress; return False where the session ends, or someone leaves, first."""
        while not self._lock.acquire(timeout=0.5 * _ENDING):
            if self._ended.is_set() or has_left():
                return False
        if self._ended.is_set():
            self._lock.release()
            return False
        return True

    def leave(self, send: Send) -> None:
        """Send nothing to someone any more; this does not wait for the step in progress."""
        self._sends.pop(send, None)

    def act(self, text: str, send: Send | None = None) -> str:
        """Do what someone asks for, and return the answer.

        Args:
            text: A command as JSON, such as ``{"do": "drag", "target": 0, "x": 1.0, "y": 1.5, "z": 2.0}``.
            send: Sends messages to the one who asks, if that one watches.
        """
        try:
            command = _COMMANDS.validate_json(text)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(map(str, first["loc"]))
            return json.dumps({"error": f"this is no command: {where}: {first['msg']}"})
        if not self._hold(lambda: send is not None and send not in self._sends):
            return json.dumps({"error": "the page has left"})
        try:
            said = self._ask(send, command) if isinstance(command, Why | Values) else command.apply(self)
            if isinstance(command, Pause | Step | Speed | Restart | Tune):
                self._tell(json.dumps(self._status()))
        except CrowdsimError as error:
            return json.dumps({"error": str(error)})
        finally:
            self._lock.release()
        return json.dumps({"done": command.do, **({"said": said} if said else {})})

    def _ask(self, send: Send | None, command: Why | Values) -> str:
        count = self.played.crowd.count
        if command.avatar is not None and not 0 <= command.avatar < count:
            raise ScenarioError(f"avatar {command.avatar}: expected a number from 0 to {count - 1}")
        # Those who have left meanwhile are told nothing.
        about = None if send is None else self._sends.get(send)
        if send is not None and about is not None:
            about[command.do] = command.avatar
            if isinstance(command, Values) and command.avatar is not None:
                send(self._values(command.avatar))
        return ""

    def _values(self, avatar: int) -> str:
        found, frame = self.played.value_map(avatar), self.played.frame - 1
        return json.dumps({"values": describe_values(found, avatar, frame)})

    def _asked(self, what: str) -> dict[int, list[Send]]:
        """Return by avatar who asks about it."""
        asked: dict[int, list[Send]] = {}
        for send, about in list(self._sends.items()):
            avatar = about.get(what)
            if avatar is not None:
                asked.setdefault(avatar, []).append(send)
        return asked

    def pause(self, paused: bool) -> None:
        """Stop the simulation, or let it go on."""
        self.paused = paused
        self._woken.set()

    def restart(self) -> str:
        """Begin again, and return a sentence on what is kept of what was played."""
        said = self._keep()
        self.played.restart()
        self._tell(json.dumps({"restart": True}))
        self._begin()
        return said

    def advance(self) -> None:
        """Simulate a control frame, and show it; nothing where the session has come to its end."""
        if self.played.is_over:
            self.pause(True)
            return
        asked = self._asked("why")
        for decision in self.played.explain() if asked else ():
            if decision.avatar in asked:
                crowd = self.played.crowd
                policy = crowd.policies[crowd.cast.policies[decision.avatar]]
                message = Passing(json.dumps({"why": describe_decision(decision, policy)}))
                for send in asked[decision.avatar]:
                    send(message)
        tuned = json.dumps(self.played.tunings())
        frame = self.played.step()
        if json.dumps(self.played.tunings()) != tuned:
            self._tell(json.dumps(self._status()))
        for avatar, sends in self._asked("values").items():
            message = Passing(self._values(avatar))
            for send in sends:
                send(message)
        self._poses.add(frame)
        self._states.append((self.played.health()[0], self.played.down().copy()))
        if self._poses.shown < 0:
            return
        document = self._document(frame)
        self._last = pack_frame(document, self._poses.poses(), self._recording.motion.bits)
        self._tell(self._last)

    def _document(self, now: Frame) -> dict[str, Any]:
        """Return what is to be known of the frame that is shown; strikes are those of the newest one."""
        shown, (health, down), crowd = self._poses.frame(), self._states[0], self.played.crowd
        clip, place = clips_of(crowd, shown)
        events = now.events
        return {
            "frame": shown.number,
            "now": now.number,
            "there": (shown.action >= 0).astype(int).tolist(),
            "opponent": shown.opponent.tolist(),
            "action": shown.action.tolist(),
            "clip": clip.tolist(),
            "place": place.tolist(),
            "down": down.astype(int).tolist(),
            "health": np.round(health.astype(float), 1).tolist(),
            "targets": np.round(shown.targets.astype(float), 4).tolist(),
            "strikes": {
                "time": np.round(events.frame / crowd.rate, 4).tolist(),
                "attacker": events.attacker.tolist(),
                "victim": events.victim.tolist(),
                "limb": events.limb.tolist(),
                "outcome": events.outcome.tolist(),
                "down": events.down.astype(int).tolist(),
                "point": np.round(events.point.astype(float), 3).ravel().tolist(),
                "speed": np.round(events.speed.astype(float), 2).tolist(),
                "damage": np.round(events.damage.astype(float), 2).tolist(),
            },
            "counts": self.played.strikes,
        }

    def _status(self) -> dict[str, Any]:
        over = self.played.is_over
        return {"paused": self.paused, "over": over, "speed": self.speed, "tunings": self.played.tunings()}

    def _tell(self, message: str | bytes) -> None:
        for send in list(self._sends):
            send(message)

    def _run(self) -> None:
        due = time.monotonic()
        while not self._ended.is_set():
            with self._lock:
                interval = 1.0 / (self.played.crowd.rate * self.speed)
                stands = self.paused or not self._sends
            self._woken.clear()
            if stands:
                # Nobody has woken it meanwhile.
                self._woken.wait(0.5)
                due = time.monotonic()
                continue
            due = next_due(due, interval, time.monotonic())
            # Where it is late, those who ask for something have their turn all the same.
            self._ended.wait(max(TURN, due - time.monotonic()))
            with self._lock:
                if not self.paused and not self._ended.is_set():
                    try:
                        self.advance()
                    except CrowdsimError as error:
                        self.paused = True
                        self._tell(json.dumps({"error": str(error)}))
                    if self.paused:
                        self._tell(json.dumps(self._status()))


def next_due(due: float, interval: float, now: float) -> float:
    """Return when the next control frame is due [s]: an interval after the last one, however late that was.

    Of a longer delay than ``BACKLOG`` only that much is caught up with, so that nothing ever hurries for long.

    Args:
        due: When the last one was due [s].
        interval: Time between control frames [s].
        now: Present time [s].
    """
    return max(due + interval, now - BACKLOG)
