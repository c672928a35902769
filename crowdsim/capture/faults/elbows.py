"""Elbows that fold backward."""

from __future__ import annotations

from dataclasses import replace

from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.folding import backward_elbows
from crowdsim.capture.reading import Reading


class Elbows:
    """Forearms that go back where they should come forward."""

    name = "elbows"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Hold the sense in which elbows fold against the one in which bodies' do."""
        if not reading.roles or not reading.finite:
            return None
        wrong = backward_elbows(reading.clip, reading.roles)
        if not wrong:
            return None
        names = " and ".join(role.replace("_", " ") for role in wrong)
        return Diagnosis(
            self.name,
            f"{names} fold{'s' if len(wrong) == 1 else ''} backward",
            0.95,
            "repair",
            f"{'it is' if len(wrong) == 1 else 'they are'} corrected to fold forward",
            lambda: replace(reading, folded=wrong),
        )
