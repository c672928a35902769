"""What is done about a fault that was found: what is usual for it, or what a user asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from crowdsim.capture.faults import Choice, Diagnosis

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
