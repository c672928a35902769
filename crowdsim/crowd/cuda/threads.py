"""What each thread of a GPU does: it calls a kernel of control for one avatar, decision, leaf or strike.

Kernels of ``crowd.kernels`` are the only implementation of what an avatar does; here is only who does it. Threads of a
launch run in any order, so each writes what no other one reads or writes. Lists are in any order, too, and nothing
depends on that.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import cuda

from crowdsim.crowd.buffers import Scratch
from crowdsim.crowd.kernels.advance import advance, switch
from crowdsim.crowd.kernels.choose import choose
from crowdsim.crowd.kernels.evaluate import evaluate
from crowdsim.crowd.kernels.kd_queries import observe_alone
from crowdsim.crowd.kernels.kd_tree import Tree, fit_leaves, fit_node
from crowdsim.crowd.kernels.layout import ENTERED, Observed
from crowdsim.crowd.kernels.observe import observe
from crowdsim.crowd.kernels.record import write_record
from crowdsim.crowd.kernels.resolve import list_strikes, note_hits
from crowdsim.crowd.kernels.shown_motion import marks_of, renew

BLOCK = 128
"""Threads of a block."""

DUE, THROWN, LOST, COUNTERS = range(4)
"""Counters of a frame: avatars that decide, strikes thrown, one more than the slot of an avatar without numbers."""


class Search(NamedTuple):
    """The tree over avatars, and scratch space of searches, by threads.

    Attributes:
        depth: Levels of the tree below its root.
        boxes: As in ``kd_tree.Tree``.
        box_teams: Likewise.
        nearest: Squared distances of neighbours. Shape (threads, most neighbours), float64.
        stack: Nodes that are still to be looked at. Shape (threads, 64), int64.
        far: How far away they are. Shape (threads, 64), float64.
    """

    depth: int
    boxes: Any
    box_teams: Any
    nearest: Any
    stack: Any
    far: Any


class Work(NamedTuple):
    """Everything that threads read and write.

    Attributes:
        model: The policies, ``arrays.Model``.
        avatars: The avatars, ``arrays.Avatars``.
        world: What they share, ``arrays.World``.
        now: The frame that is decided, ``layout.Now``.
        record: Where the frame is recorded, ``arrays.Record`` of one row.
        counters: See ``DUE``. Shape (``COUNTERS``,), int32.
        due: Slots of the avatars that decide. Shape (N,), int32.
        chosen: What each of them has chosen. Shape (N,), int32.
        spare: Scratch space. Shape (N,), int32.
        fresh: Slots of avatars that have just entered. Shape (N,), int32.
        entered: How many these are.
        first: The first decision of those that are worked on together.
        reach: How far away neighbours are at the most [m].
        observed: What each of these observes, ``layout.Observed``.
        search: The tree.
        scratch: Scratch space: that of ``buffers.Scratch`` for one avatar, by threads; its ``starts`` serve all.
        strikes: Strikes thrown. Shape (n,), ``STRIKE``.
        last_hits: The last of the strikes at each avatar number, -1 for none. Shape (N,), int32.
        hits_before: The strike at the same avatar before each strike, -1 for none. Shape (n,), int32.
    """

    model: Any
    avatars: Any
    world: Any
    now: Any
    record: Any
    counters: Any
    due: Any
    chosen: Any
    spare: Any
    fresh: Any
    entered: int
    first: int
    reach: float
    observed: Any
    search: Any
    scratch: Any
    strikes: Any
    last_hits: Any
    hits_before: Any


@cuda.jit(device=True)
def tree_of(avatars, now, search):
    """Return the tree over the avatars that are present."""
    present = now.present
    return Tree(
        avatars.x[:present], avatars.z[:present], avatars.number[:present], avatars.team[:present],
        search.depth, search.boxes, search.box_teams,
    )  # fmt: skip


@cuda.jit(device=True)
def observed_by(observed, row):
    """Return what the avatar of a row observes."""
    last = row + 1
    return Observed(observed.opponents[row:last], observed.counts[row:last], observed.neighbours[row:last])


@cuda.jit(device=True)
def scratch_of(scratch, row):
    """Return the scratch space of a row."""
    return Scratch(
        scratch.situations[row], scratch.states[row], scratch.cohorts[row], scratch.policies[row], scratch.order[row],
        scratch.starts[0], scratch.values[row], scratch.begins[row], scratch.spots[row], scratch.parts[row],
        scratch.nears[row], scratch.cells[row], scratch.work[row], scratch.frames[row], scratch.rows[row],
        scratch.layers[row], scratch.layer_shares[row], scratch.near[row],
    )  # fmt: skip


def renew_mark(work):
    """Let a mark stay old that is, of those whose turn it is."""
    marks, frame = work.avatars.marks, work.now.frame
    first, last = marks_of(marks, frame)
    k = first + cuda.grid(1)
    if k < last:
        renew(marks, frame, k)


def advance_avatar(work):
    """Move an avatar by one frame, and list it where its action has ended."""
    i = cuda.grid(1)
    if i < work.now.present:
        held = advance(work.model, work.avatars, work.world, work.now.frame, i, i + 1, work.spare[i:], False)
        if held < 0:
            cuda.atomic.max(work.counters, LOST, i + 1)
        elif held > 0:
            work.due[cuda.atomic.add(work.counters, DUE, 1)] = i


def hold_avatar(work):
    """Put an avatar that has just entered back to where it was: at the end of the action that brings it in."""
    k = cuda.grid(1)
    if k < work.entered:
        i = work.fresh[k]
        motion, playback = work.avatars.motion, work.avatars.playback
        is_listed = motion[i]["phase"] >= work.model.actions[motion[i]["action"]]["length"]
        motion[i]["phase"] = playback[i]["phase_before"]
        playback[i]["action_before"] = ENTERED
        if not is_listed:
            work.due[cuda.atomic.add(work.counters, DUE, 1)] = i


def fit_leaf(work):
    """Fit the box of a leaf to where avatars are now."""
    leaf = cuda.grid(1)
    if leaf < 1 << work.search.depth:
        tree = tree_of(work.avatars, work.now, work.search)
        fit_leaves(tree, leaf, leaf + 1)


def fit_inner_nodes(work):
    """Fit all inner nodes, level by level; one block does it."""
    tree = tree_of(work.avatars, work.now, work.search)
    for above in range(work.search.depth):
        level = 1 << (work.search.depth - 1 - above)
        for node in range(level + cuda.threadIdx.x, 2 * level, cuda.blockDim.x):
            fit_node(tree, node)
        cuda.syncthreads()


def find_neighbours(work):
    """Find the nearest opponent of an avatar that decides, and its neighbours."""
    row = cuda.grid(1)
    q = work.first + row
    if row < work.observed.counts.shape[0] and q < work.counters[DUE]:
        tree, search, own = tree_of(work.avatars, work.now, work.search), work.search, work.due[q]
        opponent = work.avatars.opponent[own]
        guess = work.avatars.slot_of[opponent] if opponent >= 0 else -1
        found, listed = observe_alone(
            tree, own, work.avatars.skip[own], guess, work.reach,
            work.observed.neighbours[row], search.nearest[row], search.stack[row], search.far[row],
        )  # fmt: skip
        work.observed.opponents[row], work.observed.counts[row] = found, listed


def observe_avatar(work):
    """Choose the opponent of an avatar that decides, and write its situation."""
    row = cuda.grid(1)
    q = work.first + row
    if row < work.observed.counts.shape[0] and q < work.counters[DUE]:
        some, scratch = observed_by(work.observed, row), scratch_of(work.scratch, row)
        observe(work.model, work.avatars, work.world, work.now, work.due[q:], 1, some, scratch)


def evaluate_actions(work):
    """Write what the next actions of an avatar that decides are worth to it."""
    row = cuda.grid(1)
    q = work.first + row
    if row < work.observed.counts.shape[0] and q < work.counters[DUE]:
        some, scratch = observed_by(work.observed, row), scratch_of(work.scratch, row)
        evaluate(work.model, work.avatars, work.world, work.now, work.due[q:], 1, some, scratch)


def choose_action(work):
    """Draw the next action of an avatar that decides."""
    row = cuda.grid(1)
    q = work.first + row
    if row < work.observed.counts.shape[0] and q < work.counters[DUE]:
        some, scratch = observed_by(work.observed, row), scratch_of(work.scratch, row)
        chosen = work.chosen[q:]
        slot = choose(work.model, work.avatars, work.world, work.now, work.due[q:], 1, some, scratch, chosen)
        if slot >= 0:
            cuda.atomic.max(work.counters, LOST, slot + 1)


def start_action(work):
    """Start the action that an avatar has chosen."""
    q = cuda.grid(1)
    if q < work.counters[DUE]:
        switch(work.model, work.avatars, work.world, work.now.frame, work.due, work.chosen, q, q + 1)


def throw_strikes(work):
    """List the strikes that an avatar has thrown since the frame before: count them, then write them."""
    i = cuda.grid(1)
    if i < work.now.present:
        first = room = 0
        for _ in range(2):
            out = work.strikes[first : first + room]
            held = list_strikes(work.model, work.avatars, work.world, work.now, i, i + 1, work.spare[i:], out, 0)
            if room > 0 or held == 0:
                break
            first, room = cuda.atomic.add(work.counters, THROWN, held), held


def link_hit(work):
    """Put a strike into the list of those at the same avatar."""
    k = cuda.grid(1)
    if k < work.counters[THROWN]:
        victim = work.strikes[k]["victim"]
        if victim >= 0:
            work.hits_before[k] = cuda.atomic.exch(work.last_hits, victim, k)


def note_hits_of_avatar(work):
    """Let an avatar note the strikes that hit it; the thread of the last one in its list does so, and empties it."""
    k = cuda.grid(1)
    if k < work.counters[THROWN]:
        victim = work.strikes[k]["victim"]
        if victim >= 0 and work.last_hits[victim] == k:
            hit = k
            while hit >= 0:
                note_hits(work.model, work.avatars, work.now.frame, work.strikes, hit, hit + 1)
                hit = work.hits_before[hit]
            work.last_hits[victim] = -1


def record_avatar(work):
    """Write what the take keeps of an avatar."""
    i = cuda.grid(1)
    if i < work.now.present:
        write_record(work.model, work.avatars, work.record, 0, i, i + 1)


THREADS = (
    *(renew_mark, advance_avatar, hold_avatar, fit_leaf, fit_inner_nodes, find_neighbours, observe_avatar),
    *(evaluate_actions, choose_action, start_action, throw_strikes, link_hit, note_hits_of_avatar, record_avatar),
)
