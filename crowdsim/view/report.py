"""A report of a run as one page: what happened, how well it looks, the player, and how to repeat it."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.core.types import Progress
from crowdsim.render.contact_sheet import sheet_frames
from crowdsim.render.look import Look
from crowdsim.render.stage import build_stage
from crowdsim.scenario.heals import Heal
from crowdsim.take.figures_text import count, number, percent, rating, time
from crowdsim.take.measures import OUT_OF_REACH, STUCK
from crowdsim.take.quality import TOUCH, measure_take
from crowdsim.take.run_text import run_sections
from crowdsim.take.take import Take
from crowdsim.view.page import asset, check_size, digest, page_parts, program_digest
from crowdsim.view.recording import Recording
from crowdsim.view.report_plots import plots

if TYPE_CHECKING:
    from crowdsim.render.source import PoseSource
    from crowdsim.take.figures_text import Row

THUMBNAILS = 6
"""How many moments a report has a picture of."""
_PICTURE, _JPEG_QUALITY = (352, 198), 88
_MOST_AVATARS = 10
"""How many avatars the list of those that landed most has."""
Verdict = tuple[bool, str]
"""Whether a figure is as it should be, and a sentence that says what it is and should be."""


def report_parts(
    take: Take,
    recording: Recording | None,
    scenario: str,
    threads: int = 1,
    progress: Progress | None = None,
    health: Mapping[str, float] | None = None,
    heals: Sequence[Heal] = (),
    pictures: PoseSource | None = None,
) -> Iterator[bytes]:
    """Yield a report of a run, part by part: one page that needs no network and no other file.

    Args:
        take: The run's take, with its policies.
        recording: What its player shows; no player when None.
        scenario: Its resolved scenario.
        threads: Threads; the report does not depend on them.
        progress: Called with stage, done and total.
        health: Health at the start of avatars that can be hurt, by the names of their types [points].
        heals: When its scenario restores health.
        pictures: The run, for pictures of moments spread over it; none when None.

    Raises:
        CrowdsimError: The player would be too large.
    """
    figures = measure_take(take.sampler, progress, threads)
    if recording is not None:
        check_size(recording)
    yield _head(take).encode()
    yield _summary(take, figures).encode()
    if pictures is not None:
        yield _thumbnails(pictures, threads).encode()
    if recording is not None:
        yield b'<iframe title="Player of the run" srcdoc="'
        for part in page_parts(recording, threads, progress):
            yield html.escape(part.decode("utf-8")).encode()
        yield b'"></iframe>\n'
    yield _verdicts(figures).encode()
    yield from (part.encode() for part in _plots(take, health or {}, heals))
    yield _teams(take).encode()
    for title, rows in run_sections(figures):
        yield _section(title, rows).encode()
    yield _repeat(take, scenario).encode()
    yield b"</body>\n</html>\n"


def _head(take: Take) -> str:
    style, player = asset("report.css"), asset("player.css")
    # The player's frame has its own policy, and may do no more than this one allows.
    policy = (
        f"default-src 'none'; script-src {program_digest()}; style-src {digest(style)} {digest(player)}; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="generator" content="crowdsim report">\n<meta name="color-scheme" content="light dark">\n'
        f'<title>{html.escape(take.scenario)}: report</title>\n<link rel="icon" href="data:,">\n'
        f"<style>{style}</style>\n</head>\n<body>\n"
    )


def _summary(take: Take, figures: Mapping[str, Any]) -> str:
    landed = figures["strikes_landed"]
    tiles = [
        (f"{figures['avatars']:,}", "avatar" if figures["avatars"] == 1 else "avatars"),
        (f"{figures['seconds']:.1f} s", count(figures["control_frames"], "control frame")),
        (f"{figures['strikes_thrown']:,}", "strikes thrown"),
        (f"{landed:,}", "of them landed"),
    ]
    if figures.get("knock_downs"):
        tiles.append((f"{figures['knock_downs']:,}", "knock-downs"))
    teams = count(len({int(team) for team in take.cast.teams}), "team")
    unfinished = "" if take.status == "done" else " The run was interrupted: this is what there is of it."
    items = "".join(f"<li><b>{html.escape(value)}</b>{html.escape(label)}</li>" for value, label in tiles)
    return (
        f"<h1>{html.escape(take.scenario)}</h1>\n"
        f'<p class="quiet">{html.escape(teams)}, seed {take.seed}.{unfinished}</p>\n<ul class="tiles">{items}</ul>\n'
    )


def _thumbnails(source: PoseSource, threads: int) -> str:
    """Return pictures of moments spread over a run, each with its time."""
    from PIL import Image

    stage, items = build_stage(source, _PICTURE, look=Look(caption=False)), ""
    for frame in sheet_frames(0, source.frame_count, THUMBNAILS):
        file, seconds = io.BytesIO(), time(frame / source.fps)
        Image.fromarray(stage.picture(frame, threads)).save(file, "JPEG", quality=_JPEG_QUALITY)
        data = base64.b64encode(file.getvalue()).decode("ascii")
        items += f'<li><img src="data:image/jpeg;base64,{data}" alt="The run after {seconds}">{seconds}</li>\n'
    return f'<ul class="moments">\n{items}</ul>\n'


def verdicts(figures: Mapping[str, Any]) -> list[Verdict]:
    """Return what the figures of ``measure_take`` mean for a scene, those that could be measured."""
    found: list[Verdict] = []

    def judge(key: str, most: float, sentence: str, shown: Any = percent, zero: str = "") -> None:
        value = figures.get(key)
        if value is not None:
            text = zero if zero and value == 0 else sentence.format(shown(value))
            found.append((value <= most, text if value <= most else f"{text}; at most {shown(most)} looks right"))

    if figures["strikes_thrown"]:
        if figures["first_landed_seconds"] is None:
            found.append((False, "No strike lands"))
        judge("first_landed_seconds", 8.0, "The first strike lands after {}", time)
        judge("air_share", 0.05, "{} of strikes are thrown at opponents beyond their reach",
              zero="No strike is thrown at an opponent beyond its reach")  # fmt: skip
    judge("stuck_share", 0.0, f"{{}} of avatars stay out of reach of their opponents for more than {STUCK:g} s",
          zero=f"No avatar stays out of reach of its opponent for more than {STUCK:g} s")  # fmt: skip
    judge("out_of_reach_share", 0.4,
          f"Opponents are further away than {OUT_OF_REACH:g} m in {{}} of the time",
          zero=f"Opponents are never further away than {OUT_OF_REACH:g} m")  # fmt: skip
    judge("turned_away_share", 0.1, "Avatars have their backs to their opponents in {} of the time",
          zero="No avatar has its back to its opponent")  # fmt: skip
    judge(
        "overlap_share", 0.03, "Avatars stand in one another in {} of the time", zero="No avatars stand in one another"
    )
    judge("penetration_share", 0.01, "Bodies are deep in others in {} of the time", zero="No body is deep in another")
    judge("fists_off_share", 0.02,
          f"{{}} of the fists and feet that land are further than {100 * TOUCH:g} cm from what they hit",
          zero=f"All fists and feet that land are within {100 * TOUCH:g} cm of what they hit")  # fmt: skip
    slide, captured = figures.get("foot_slide_median"), figures.get("foot_slide_median_captured")
    if slide is not None and captured:
        good = slide <= 1.5 * captured
        more = "" if good else "; at most 1.5 times looks right"
        found.append((good, f"Planted feet slide {rating(slide, captured).replace('as the', 'as much as the')}{more}"))
    jump = figures.get("transition_jump_ratio")
    if jump is not None:
        more = "" if jump <= 1.5 else "; at most 1.5 times looks right"
        found.append((jump <= 1.5, f"Joints accelerate {number(jump, 3)} times the capture's around transitions{more}"))
    return found


def _verdicts(figures: Mapping[str, Any]) -> str:
    items = "".join(
        f'<li><b class="{"good" if good else "look"}">{"good" if good else "look at"}</b>{html.escape(text)}.</li>\n'
        for good, text in sorted(verdicts(figures))
    )
    return f'<h2>How it looks</h2>\n<ul class="verdicts">\n{items}</ul>\n' if items else ""


def _plots(take: Take, health: Mapping[str, float], heals: Sequence[Heal]) -> Iterator[str]:
    """Yield plots over time."""
    found = list(plots(take, health, heals))
    if found:
        yield "<h2>Over time</h2>\n"
        yield from found


def _teams(take: Take) -> str:
    """Return tables of teams and of the avatars that landed most."""
    cast, events = take.cast, take.events
    attackers, victims = np.asarray(events.attacker, np.int64), np.asarray(events.victim, np.int64)
    landed = np.asarray(events.landed, bool)
    everyone = len(cast.names)
    thrown, hits = (np.bincount(one, minlength=everyone) for one in (attackers, attackers[landed]))
    received = np.bincount(victims[landed & (victims >= 0)], minlength=everyone)
    downs = np.bincount(victims[np.asarray(events.down, bool) & (victims >= 0)], minlength=everyone)
    columns = ("thrown", "landed", "received", "knocked down")
    figures = np.stack([thrown, hits, received, downs], axis=1)
    teams, text = np.unique(np.asarray(cast.teams, int)), ""
    if 1 < len(teams) <= 50:
        rows = [
            [cast.team_names[team], int((cast.teams == team).sum()), *figures[cast.teams == team].sum(axis=0)]
            for team in teams
        ]
        text += "<h2>Teams</h2>\n" + _table(("team", "avatars", *columns), rows)
    best = np.lexsort([np.arange(everyone), -hits])[:_MOST_AVATARS]
    if hits.any():
        rows = [[cast.names[one], cast.team_names[cast.teams[one]], *figures[one]] for one in best if hits[one]]
        text += "<h2>Avatars that landed most</h2>\n" + _table(("avatar", "team", *columns), rows, 2)
    return text


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]], texts: int = 1) -> str:
    """Return a table, its columns but for the first ones numbers."""

    def line(kind: str, row: Sequence[Any]) -> str:
        cells = [
            f"<{kind}>{html.escape(str(value))}</{kind}>"
            if i < texts
            else f'<{kind} class="number">{html.escape(value if isinstance(value, str) else f"{value:,}")}</{kind}>'
            for i, value in enumerate(row)
        ]
        return f"<tr>{''.join(cells)}</tr>"

    body = "\n".join(line("td", row) for row in rows)
    return f"<table>\n<thead>{line('th', head)}</thead>\n<tbody>\n{body}\n</tbody>\n</table>\n"


def _section(title: str, rows: Iterable[Row]) -> str:
    lines = [
        f"<tr><th>{html.escape(label)}</th><td>{html.escape(text)}</td></tr>"
        for label, text in rows
        if text is not None
    ]
    body = "\n".join(lines)
    return f"<h2>{html.escape(title)}</h2>\n<table>\n<tbody>\n{body}\n</tbody>\n</table>\n" if lines else ""


def _repeat(take: Take, scenario: str) -> str:
    policies = "\n".join(
        f"policy {name}: {fingerprint}"
        for name, fingerprint in zip(take.cast.policy_names, take.fingerprints, strict=True)
    )
    return (
        f"<h2>How to repeat it</h2>\n<p>The scenario below, saved as <code>scenario.yaml</code>, gives the same run "
        "byte for byte with the same version of crowdsim, the same policies and the same kind of processor:</p>\n"
        f"<pre>crowdsim run scenario.yaml\n\n{html.escape(policies)}</pre>\n"
        "<details>\n<summary>The scenario, with all defaults</summary>\n"
        f"<pre>{html.escape(scenario)}</pre>\n</details>\n"
    )
