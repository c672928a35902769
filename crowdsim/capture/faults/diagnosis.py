"""What a kind of fault is, what is said about one that is found, and what is done about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from crowdsim.capture.reading import Reading

Action = Literal["repair", "leave_out", "refuse"]
"""What is done about a fault: its repair; frames are left out; or the file is not trained on."""
Choice = Literal["repair", "keep", "refuse"]
"""What a user may ask for: the repair, sure or not; the motion as it is in the file; or no training on it."""

SURE = 0.9
"""Confidence from which on a repair is made without being asked for."""


@dataclass(frozen=True)
class Diagnosis:
    """A fault that was found in a file.

    Attributes:
        fault: Its kind, the name of the ``Fault``.
        what: What is wrong, with frames and figures.
        confidence: How sure that is, 0 to 1.
        action: What is done about it unless a user asks for something else.
        remedy: What the repair does, after "it is" or "they are"; empty where there is none.
        repair: Returns the repaired reading; None where there is no repair.
        needed: Whether the motion cannot be read at all without the repair, whatever a user asks for.
        given: What a user may give for this kind of fault instead of a choice, in words.
    """

    fault: str
    what: str
    confidence: float
    action: Action
    remedy: str = ""
    repair: Callable[[], Reading] | None = None
    needed: bool = False
    given: str = ""


class Fault(Protocol):
    """A kind of fault."""

    @property
    def name(self) -> str:
        """What it is called in findings and recipes."""

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Return what is wrong with a reading; None where nothing of this kind is."""


def by_confidence(confidence: float) -> Action:
    """Return the action for a fault whose repair restores the motion: it is made where the fault is sure."""
    return "repair" if confidence >= SURE else "refuse"


Done = Literal["repaired", "left_out", "refused", "kept"]


@dataclass(frozen=True)
class Outcome:
    """A diagnosis, and what is done about it.

    Attributes:
        diagnosis: What was found.
        done: What is done.
        asked: Whether a user asked for that.
    """

    diagnosis: Diagnosis
    done: Done
    asked: bool = False

    @property
    def refused(self) -> bool:
        """Whether the file is not to be trained on."""
        return self.done == "refused"

    @property
    def words(self) -> str:
        """What was found, how sure that is, and what is done."""
        found = self.diagnosis
        sure = f"{self.diagnosis.fault}: {found.what} ({100.0 * found.confidence:.0f} % sure)"
        if self.done == "kept":
            return f"{sure}; kept as it is, as asked"
        if self.refused:
            ways = [f"repair ({found.remedy})"] * (found.repair is not None) + ["keep"] * (not found.needed)
            ways += [found.given] * bool(found.given)
            unless = "as asked" if self.asked else f"unless motion.capture.faults says {' or '.join(ways)}"
            return f"{sure}; not trained on, {unless}"
        return f"{sure}; {found.remedy}{', as asked' if self.asked else ''}"


def decide(diagnosis: Diagnosis, choice: Choice | None = None) -> Outcome:
    """Return what is done about a fault: what is usual, or what a user asks for where that is possible."""
    if choice == "keep" and not diagnosis.needed:
        return Outcome(diagnosis, "kept", True)
    if choice == "refuse":
        return Outcome(diagnosis, "refused", True)
    if choice == "repair" and diagnosis.repair is not None:
        return Outcome(diagnosis, "left_out" if diagnosis.action == "leave_out" else "repaired", True)
    usual: dict[str, Done] = {"repair": "repaired", "leave_out": "left_out", "refuse": "refused"}
    return Outcome(diagnosis, usual[diagnosis.action])
