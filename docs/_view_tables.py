"""The table of docs/view.md: pages of the player, with the goals that they have."""

from __future__ import annotations

from collections.abc import Callable

from _results import Results, at_least, at_most, scaled

PAGES = {"30": "`brawl_30`, 67 s, 60 fps", "1000": "1,000 boxers, 10 s, 30 fps", "10000": "10,000 boxers, 1 s, 30 fps"}
FIGURES = {
    "page [MB]": "megabytes",
    "posing [s]": "posing_seconds",
    "seconds beyond posing": "seconds",
    "first picture after a cold start of the browser [s]": "first_picture_seconds",
    "median time of a picture [ms]": "frame_milliseconds",
    "greatest error of a joint [mm]": "error_millimetres",
}
GOALS = {
    "30": {"megabytes": 6.5, "seconds": 1.0, "first_picture_seconds": 1.5, "frame_milliseconds": 33.4,
           "error_millimetres": 1.2},
    "1000": {"megabytes": 21.0, "first_picture_seconds": 2.0, "frame_milliseconds": 100.0},
    "10000": {"frame_milliseconds": 200.0},
}  # fmt: skip
"""The most that figures of each page may be."""


def player(results: Results) -> list[str]:
    """Return what pages of the player cost, and how soon and how fast Chromium shows them without graphics hardware."""
    # Joints of large crowds are packed as those of thirty are.
    rows = [
        [label, *(results.cell(at_most(GOALS[page].get(figure)), "view", "pages", page, figure)
                  if page == "30" or figure != "error_millimetres" else "" for page in PAGES)]
        for label, figure in FIGURES.items()
    ]  # fmt: skip
    return results.table(["", *PAGES.values()], rows, "view")


LIVE = {
    "control, a control frame [ms]": ("control_milliseconds", at_most(0.67)),
    "poses, a control frame [ms]": ("pose_milliseconds", at_most(8.0)),
    "share of a core, the page open [%]": ("core_share", scaled(100.0, "", at_most(25.0))),
    "control frames a second that arrive": ("frames_per_second", at_least(14.95)),
    "from a drag to the picture, median [ms]": ("drag_to_picture_ms", at_most(50.0)),
    "from a drag to the picture, 95 % within [ms]": ("drag_to_picture_95_ms", at_most(90.0)),
}
"""Rows of what is played live: keys, and formats with goals. At 15 frames a second 1 % of a core is 0.67 ms."""


def live(results: Results) -> list[str]:
    """Return what ``brawl_30`` costs while it is played, and how soon a drag shows."""
    rows = [[label, results.cell(shown, "view", "play", key)] for label, (key, shown) in LIVE.items()]
    return results.table(["", "`brawl_30`, played live"], rows, "view")


VIEW_TABLES: dict[str, Callable[[Results], list[str]]] = {"player": player, "live": live}
