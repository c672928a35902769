"""Themes of clips: how often a boxer does what."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Theme:
    """What a clip is about: weights of its phrases, and the longest pauses between them [s].

    Attributes:
        combination: Punches, with or without small steps.
        stepping: Small steps.
        turning: Turns on the spot.
        defence: Defences.
        counter: Defences, and punches out of them.
        rest: Standing still in the guard.
        travel: Walks and jogs out of the guard and back.
        shuffling: Quick steps in the guard, any way.
        pressing: Quick steps forward, with punches on the way.
        bouncing: Quick steps on the spot.
        pause: Longest pause between phrases [s].
    """

    combination: float
    stepping: float
    turning: float
    defence: float
    counter: float
    rest: float
    travel: float
    shuffling: float
    pressing: float
    bouncing: float
    pause: float


THEMES = (
    Theme(6.5, 0.3, 0.20, 0.9, 2.0, 0.10, travel=0.65, shuffling=0.6, pressing=0.9, bouncing=0.35, pause=0.18),
    Theme(8.0, 0.2, 0.15, 0.5, 1.6, 0.08, travel=0.65, shuffling=0.6, pressing=0.9, bouncing=0.40, pause=0.18),
    Theme(5.5, 0.4, 0.30, 0.7, 1.6, 0.10, travel=0.65, shuffling=1.2, pressing=0.7, bouncing=0.50, pause=0.18),
    Theme(5.5, 0.2, 0.15, 1.1, 3.4, 0.10, travel=0.65, shuffling=0.6, pressing=0.7, bouncing=0.35, pause=0.18),
    Theme(3.0, 0.2, 0.10, 0.4, 0.8, 0.05, travel=3.0, shuffling=1.0, pressing=1.2, bouncing=0.30, pause=0.16),
)
EXCHANGE = Theme(6.0, 1.2, 0.3, 1.0, 1.5, 0.0, travel=0.0, shuffling=1.6, pressing=0.0, bouncing=0.0, pause=0.12)
"""What a boxer does who is at blows."""
