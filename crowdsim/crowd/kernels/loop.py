"""All stages of many frames in one function, for a small crowd."""

import numpy as np

from crowdsim.crowd.kernels.advance import advance, switch
from crowdsim.crowd.kernels.clock import note_time
from crowdsim.crowd.kernels.decide import decide
from crowdsim.crowd.kernels.kd_tree import everyone
from crowdsim.crowd.kernels.knock_downs import empty_room, knock_down
from crowdsim.crowd.kernels.layout import Now, Observed
from crowdsim.crowd.kernels.opponents import observe_all
from crowdsim.crowd.kernels.record import write_record
from crowdsim.crowd.kernels.records import THROWN
from crowdsim.crowd.kernels.resolve import list_strikes, note_hits, resolve
from crowdsim.crowd.kernels.shown_motion import renew_marks
from crowdsim.crowd.kernels.staggers import NEIGHBOURS, SEES, list_thrown, stagger
from crowdsim.jit import kernel


@kernel(allocates=True)
def run_frames(model, avatars, world, now, count, still, fresh, scratch, record, strikes, timings):
    """Run ``count`` control frames from ``now`` on for a small crowd, and record them.

    ``still``: no avatar moves in the first frame; those in slots ``fresh`` decide. ``timings`` (count, 6) takes the
    time of index, observe, choose, advance, strikes and record [ns]; without rows no clock is read. Returns the frames
    done, which are fewer where room for strikes may not last, an avatar is knocked down, or events wait for strikes
    and some are thrown; the number of strikes; and the slot of an avatar whose position or values are not numbers,
    or -1.
    """
    present = now.present
    due, chosen = np.empty(present, np.int32), np.empty(present, np.int32)
    distances, hits = np.empty(present), np.empty(present, np.int64)
    thrown = np.empty(present, THROWN)
    most = scratch.near.shape[0]
    room = empty_room(model, most)
    observed = Observed(np.empty(present, np.int32), np.empty(present, np.int32), np.empty((present, most), np.int32))
    clock = np.empty(8, np.int64)
    held = 0
    for k in range(count):
        if held + 8 * present > strikes.shape[0] and k > 0:
            return k, held, -1
        then = Now(now.frame + k, now.moment + k, present)
        note_time(timings, clock, 0)
        renew_marks(avatars.marks, then.frame)
        dues = _find_due(model, avatars, world, then, due, still and k == 0, fresh)
        if dues < 0:
            return k, held, -1 - dues
        note_time(timings, clock, 1)
        observe_all(avatars, present, due, dues, world.crowding.sight, observed, distances, hits)
        note_time(timings, clock, 2)
        lost = _decide_all(model, avatars, world, then, due[:dues], observed, scratch, chosen)
        if lost >= 0:
            return k, held, lost
        note_time(timings, clock, 3)
        switch(model, avatars, world, then.frame, due, chosen, 0, dues)
        note_time(timings, clock, 4)
        before = held
        held = list_strikes(model, avatars, world, then, 0, present, due, strikes, held)
        felled = 0
        # What creates arrays is called in as few frames as can be: it counts references to all that it is handed.
        if avatars.conditions.shape[0] > 0 and held > before:
            felled, held = resolve(model, avatars, world, then.frame, strikes, before, held)
        else:
            note_hits(model, avatars, then.frame, strikes, before, held)
        if felled > 0:
            tree = everyone(avatars, present)
            knock_down(model, avatars, world, then, strikes, before, held, tree, observed, room)
        staggering = list_thrown(model, avatars, world, then, strikes, before, held, thrown)
        if staggering > 0:
            _stagger(model, avatars, world, then, thrown[:staggering], due, distances, hits)
        note_time(timings, clock, 5)
        write_record(model, avatars, record, k, 0, present)
        note_time(timings, clock, 6)
        _write_times(timings, clock, k)
        if felled > 0 or (world.pauses[0] != 0.0 and held > before):
            return k + 1, held, -1
    return count, held, -1


@kernel(allocates=True)
def _stagger(model, avatars, world, now, thrown, due, distances, hits):
    """Let avatars stagger that ``list_thrown`` has listed; the rest is scratch space."""
    count = thrown.shape[0]
    for q in range(count):
        due[q] = thrown[q].slot
    room = Observed(np.empty(count, np.int32), np.empty(count, np.int32), np.empty((count, NEIGHBOURS), np.int32))
    observe_all(avatars, now.present, due, count, SEES, room, distances, hits)
    stagger(model, avatars, world, now, thrown, room)


@kernel(inline=True)
def _find_due(model, avatars, world, now, due, still, fresh):
    """Move avatars by one frame and list those whose action has ended; where all stand ``still``, list ``fresh``."""
    if still:
        for i in range(fresh.shape[0]):
            due[i] = fresh[i]
        return fresh.shape[0]
    return advance(model, avatars, world, now.frame, 0, now.present, due, True)


@kernel(inline=True)
def _decide_all(model, avatars, world, now, due, observed, scratch, out_chosen):
    """Let avatars ``due`` decide, as many at a time as scratch space has room for."""
    room, lost = scratch.states.shape[0], -1
    for start in range(0, due.shape[0], room):
        some = Observed(observed.opponents[start:], observed.counts[start:], observed.neighbours[start:])
        count = min(room, due.shape[0] - start)
        lost = max(lost, decide(model, avatars, world, now, due[start:], count, some, scratch, out_chosen[start:]))
    return lost


@kernel(inline=True)
def _write_times(timings, clock, k):
    """Write the times of the stages of a frame, if requested."""
    if timings.shape[0] > 0:
        timings[k, 0] = 0
        timings[k, 1] = clock[2] - clock[1]
        timings[k, 2] = clock[3] - clock[2]
        timings[k, 3] = clock[1] - clock[0] + clock[4] - clock[3]
        timings[k, 4] = clock[5] - clock[4]
        timings[k, 5] = clock[6] - clock[5]
