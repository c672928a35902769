"""What the command ``batch`` prints: its plan, how far it is, and what came of it."""

from __future__ import annotations

import shutil
import sys
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from crowdsim.commands import common
from crowdsim.commands.common import size_text
from crowdsim.commands.process import escaped, terminal

if TYPE_CHECKING:
    from crowdsim.batch.plan import Plan
    from crowdsim.batch.progress import Progress
    from crowdsim.batch.session import Outcome


def plan_lines(plan: Plan, done: Collection[str]) -> Iterator[str]:
    """Yield the runs of a plan with what they take, and all together."""
    labels = {id: str(one) for one, id in reversed(plan.combinations)}
    width = max(map(len, labels.values()))
    heads = "".join(f"  {name:>9}" for name in ("avatars", "frames", "disk", "memory"))
    yield f"{'run':<{width}}  {'id':<16}  {'seed':>6}{heads}  minutes"
    for id, run in plan.runs.items():
        needed = run.estimate
        yield (
            f"{labels[id]:<{width}}  {id}  {run.seed:>6}  {run.avatars:>9,}  {run.control_frames:>9,}  "
            f"{size_text(needed.bytes):>9}  {size_text(needed.memory):>9}  {needed.seconds / 60:7.2f}"
            + ("  done" if id in done else "")
        )
    left = [run for id, run in plan.runs.items() if id not in done]
    total, most = sum(run.estimate.bytes for run in left), max((run.estimate.memory for run in left), default=0.0)
    minutes = sum(run.estimate.seconds for run in left) / 60
    same = len(plan.combinations) - len(plan.runs)
    yield (
        f"{len(left):,} of {len(plan.runs):,} runs to do: {size_text(total)} on disk, {size_text(most)} of memory a "
        f"worker, {minutes:.1f} minutes of one core"
    )
    if same:
        yield f"{same:,} combinations give the same scenario as another one, and are not run again"


def time_text(seconds: float) -> str:
    """Return a time in the units that suit it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class BatchBars:
    """How far a batch is, on standard error; called with its progress.

    On a terminal there is a bar for all runs and one for each that a worker is at. Elsewhere each run that ends has a
    line of plain text. With ``--quiet`` there is neither.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._live, self._quiet = plan, sys.stderr.isatty(), common.talk.quiet
        self._labels = {id: str(one) for one, id in reversed(plan.combinations)}
        self._ended: set[str] | None = None
        self._all: Any = None
        self._each: dict[str, Any] = {}

    def __call__(self, progress: Progress) -> None:
        """Show it."""
        ended = progress.done | progress.failed
        if self._quiet:
            return
        if self._ended is None:
            self._ended = set(progress.done)
            if progress.done:
                self.note(f"{len(progress.done):,} of {len(self._plan.runs):,} runs are finished already")
        left = progress.seconds_left()
        remaining = "" if left is None or len(ended) == len(self._plan.runs) else f", about {time_text(left)} left"
        if self._live:
            self._show_bars(progress, remaining)
        for number, id in enumerate(sorted(ended - self._ended, key=list(self._plan.runs).index)):
            what = "failed" if id in progress.failed else "done"
            count = f"{len(self._ended) + number + 1:,} of {len(self._plan.runs):,}"
            if not self._live or what == "failed":
                self.note(f"{count}: {self._labels[id]}: {what}{remaining}")
        self._ended |= ended

    def note(self, text: str) -> None:
        """Print a line of its own, above the bars where there are some."""
        if self._quiet:
            return
        if self._all is not None:
            self._all.write(escaped(text), file=terminal())
        else:
            print(text, file=sys.stderr, flush=True)

    def _show_bars(self, progress: Progress, remaining: str) -> None:
        from tqdm import tqdm

        # Some terminals say that they have no columns and no rows.
        columns, rows = shutil.get_terminal_size((80, 24))
        size: dict[str, Any] = {"file": terminal(), "ncols": columns, "nrows": rows}
        if self._all is None:
            form = "{desc}: {n_fmt} of {total_fmt} |{bar}| {elapsed}{postfix}"
            total = len(self._plan.runs)
            self._all = tqdm(total=total, desc="runs", bar_format=form, position=0, **size)
        self._all.n = len(progress.done | progress.failed)
        self._all.set_postfix_str(remaining.removeprefix(", "), refresh=False)
        self._all.refresh()
        for id in [id for id in self._each if id not in progress.active]:
            self._each.pop(id).close()
        for id, (stage, done, total) in list(progress.active.items())[:8]:
            if id not in self._each:
                form = "  {desc} |{bar:20}| {n_fmt} of {total_fmt}"
                self._each[id] = tqdm(bar_format=form, leave=False, **size)
            bar = self._each[id]
            bar.set_description_str(f"{self._labels[id]}, {stage}", refresh=False)
            bar.total, bar.n = total, done
            bar.refresh()

    def __enter__(self) -> BatchBars:
        return self

    def __exit__(self, *_: object) -> None:
        for bar in self._each.values():
            bar.close()
        with suppress(AttributeError):
            self._all.close()


def print_outcome(outcome: Outcome) -> None:
    """Print what came of a batch, on one screen."""
    from crowdsim.batch.attempts import KINDS
    from crowdsim.batch.plan import REPORT
    from crowdsim.batch.report import INDEX, SUMMARY

    seconds = outcome.seconds
    print(outcome.folder)
    kept = f", {outcome.kept:,} before" if outcome.kept else ""
    print(f"  runs      {len(outcome.plan.runs):,}: {outcome.done:,} done{kept}, {len(outcome.failures):,} failed")
    if outcome.left:
        print(f"  left      {outcome.left:,}, after the first failure")
    causes = Counter(failure["cause"] for failure in outcome.failures.values())
    for cause, count in causes.most_common():
        print(f"  failed    {count:,}: {KINDS.get(cause, cause)}")
    for failure in list(outcome.failures.values())[:10]:
        print(f"  to repeat {failure['command']}")
    print(f"  report    {outcome.folder / REPORT / INDEX}, {SUMMARY}")
    print(f"  seconds   {', '.join(f'{stage} {value:.1f}' for stage, value in seconds.items())}")
