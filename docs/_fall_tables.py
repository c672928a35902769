"""Tables of falls and of bodies that lie, for ``docs/quality.md``."""

from __future__ import annotations

from collections.abc import Callable

from _results import NOT_MEASURED, Results, fixed, number, percent, scaled


def _pair(results: Results, group: str, *keys: str) -> str:
    """Return a figure of shown motion and, in brackets, that of the capture behind it."""
    own, theirs = (
        results.cell(fixed, "motion_quality", "boxer", "falls", "motion", group, *keys, side)
        for side in ("shown", "captured")
    )
    return own if own == theirs == NOT_MEASURED else f"{own} ({theirs})"


def fall_motion(results: Results) -> list[str]:
    """Return how smooth motion is near transitions of falls and near all others of the same fights."""

    def cells(*keys: str) -> list[str]:
        return [_pair(results, group, *keys) for group in ("falls", "others")]

    rows = [
        [f"{part}, {label} [per mille]", *cells(part, kind)]
        for part in ("legs", "trunk", "arms", "head")
        for kind, label in (("acceleration", "positions"), ("rotation", "rotations"), ("joint", "joints"))
    ]
    rows += [
        ["one-frame jumps of joints in a thousand transitions", *cells("jumps")],
        ["slide of feet on the floor, median [m/s]", *cells("slide_median")],
        ["the same, 95th percentile [m/s]", *cells("slide_95")],
    ]
    header = ["`boxer` (of the capture behind)", "into falls and staggers and out of them", "other transitions"]
    return results.table(header, rows, "motion_quality")


def lying(results: Results) -> list[str]:
    """Return how bodies that are down meet the floor, feet of others, and one another."""
    centimetres = scaled(100.0, shown=number)
    rows = [
        [label, results.cell(shown, "fights", "lying", key)]
        for label, shown, key in (
            ("lowest point of a body, from the fall to standing [cm]", centimetres, "lowest"),
            ("greatest height of a body's lowest point [cm]", centimetres, "highest"),
            ("frames in which it is more than 1 cm below the floor", percent, "sunk_share"),
            ("frames in which it is more than 1 cm above the floor", percent, "floating_share"),
            ("lying frames in which the axis of a foot of another is inside the body", percent, "trodden_share"),
            ("lying frames in which a foot of another touches the body", percent, "touched_share"),
            ("lying pairs nearer than 2.4 m that are deeper than 6 cm in one another", percent, "overlap_share"),
            ("lying frames in which a body is deeper than 6 cm in another", percent, "overlap_frames_share"),
        )
    ]
    return results.table(["", "`brawl_last_standing`"], rows, "fights")


FALL_TABLES: dict[str, Callable[[Results], list[str]]] = {"fall-motion": fall_motion, "lying": lying}
