"""Compiled limbs: legs that keep planted feet in their place, fists that touch, and bodies that give way to blows.

A stand is a time over which a foot is planted, through cuts. At a cut the motion's own place of the foot jumps by
delta. With E a step from 0 to 1, a foot belongs at ``motion(t) + sum over cuts of delta (E(t) - [t >= cut])``, which
goes on through cuts, and moves only where E does: E rises while the foot is in the air before or after the stand, or in
a step that the foot makes for the cut, see ``plan_falls``. What moves planted feet besides is the capture's own. The
turn of the foot, and of its toes, goes along; a heel that is far up comes down with the blend. Between stands a foot is
let go of, or led from one place to the next where they follow closely.

The pelvis goes down a little, and evenly, for a leg that would be overstretched; soles stay above the floor.

A fist is carried onto what it hits by a bump over time; for what an arm that eases into its longest reach does not
give, the trunk leans by a longer one. A blow turns spine, neck and head along its way, and they spring back.
"""

import math

import numpy as np

from crowdsim.jit import kernel

MOST = math.radians(150.0)
"""Flexion beyond which no knee or elbow is bent [rad]."""
TILTED = math.radians(30.0)
"""Tilt of a foot over a cut beyond which it does not wait for a step [rad]."""
FOLDED = math.radians(145.0)
"""Flexion towards which elbows go at the most to bring a fist near [rad]."""


@kernel
def _ease(s):
    """A step from 0 to 1 with no speed and no acceleration at its ends."""
    if s <= 0.0:
        return 0.0
    if s >= 1.0:
        return 1.0
    return s * s * s * (10.0 - s * (15.0 - 6.0 * s))


@kernel
def _soft(x):
    """A bend from 0 to x, without a corner."""
    if abs(x) > 30.0:
        return max(x, 0.0)
    return x + math.log1p(math.exp(-x)) if x > 0.0 else math.log1p(math.exp(x))


@kernel
def _share(cuts, falls, cut, foot, time, begin, end):
    """How far a foot has gone over a cut in a stand, from 0 to 1, and how high it is."""
    at = cuts.times[cut]
    if at <= begin:
        return 1.0, 0.0
    if at >= end:
        return 0.0, 0.0
    low, high = falls.moves[cut, foot, 0], falls.moves[cut, foot, 1]
    part = (time - low) / (high - low)
    rise = part * (1.0 - part) if 0.0 < part < 1.0 else 0.0
    return _ease(part), 64.0 * rise * rise * rise * falls.moves[cut, foot, 2]


@kernel
def _add_shift(m, cuts, falls, first, stop, foot, rate, pace, scale, time, begin, end, weight, shift, turn, toes, way):
    """Add, times a weight, how far a foot belongs from the motion's own place in a stand, and turn it and its toes.

    Cuts that are past are undone from the latest back, those to come follow from the next on.
    """
    middle = first
    while middle < stop and (cuts.times[middle] - time) * rate <= 1e-9:
        middle += 1
    for k in range(first, stop):
        cut = middle - 1 - (k - first) if k < middle else k
        share, lift = _share(cuts, falls, cut, foot, time, begin, end)
        cut_at, old, new = cuts.times[cut], cuts.before[cut], cuts.after[cut]
        apart, through = time - cut_at, begin < cut_at < end
        ahead, behind = cuts.spans[cut, 0], cuts.spans[cut, 1]
        gap, tilt = cuts.gaps[cut, foot], share
        if through and gap[3] * gap[3] + gap[5] * gap[5] > TILTED * TILTED:
            # A heel comes up or down with the blend; only where the foot stands, and looks, waits for its step.
            tilt = _ease((apart + ahead) / (ahead + behind))
        if k < middle:
            share, tilt = share - 1.0, tilt - 1.0
        for j in range(9):
            way[j] = (share if j < 3 or j == 4 else tilt) * gap[j]
        # As in the blend both motions play on; through a stand for as long as the foot stands in them, or while it is
        # in the air for the moment of the cut, else up to it.
        stands = through and (m.contacts[old, foot] or m.contacts[new, foot])
        if cut_at >= end:
            ahead = min(ahead, cut_at - end)
        elif cut_at <= begin:
            behind = min(behind, begin - cut_at)
        elif not stands:
            ahead = min(ahead, (old - m.stands[old, foot, 0]) / pace)
            behind = min(behind, (m.stands[new, foot, 1] - new) / pace)
        play_on = -ahead < apart < behind
        if play_on:
            part = _ease((apart + ahead) / (ahead + behind))
            if k < middle:
                part -= 1.0
            steps, looks = apart * pace, cuts.looks[cut]
            _goes_on(m, foot, old, steps, looks[0, 0], looks[0, 1], scale, stands, -part, way)
            _goes_on(m, foot, new, steps, looks[1, 0], looks[1, 1], scale, stands, part, way)
        if share != 0.0 or tilt != 0.0 or play_on:
            for j in range(3):
                shift[j] += weight * way[j]
            _turn_by(turn, way[3], way[4], way[5])
            _turn_by(toes, way[6], way[7], way[8])
        shift[1] += weight * lift


@kernel
def _goes_on(m, foot, start, steps, cos, sin, scale, stands, share, way):
    """Add a share of what a foot does from a frame on: its way, its turn, that of its toes.

    The clip is turned by the angle of a cosine and a sine. Where the foot ``stands`` only for as long as it does.
    """
    first, last = m.bounds[start, 0], m.bounds[start, 1]
    if stands:
        first = last = start
        if m.contacts[start, foot]:
            first, last = m.stands[start, foot, 0], m.stands[start, foot, 1]
    frame = min(max(start + steps, float(first)), float(last))
    low = int(frame)
    part = frame - low
    rest = 1.0 - part
    old, here, there = m.tracks[start, foot], m.tracks[low, foot], m.tracks[low + 1 if part > 0.0 else low, foot]
    x, y = here[0] * rest + there[0] * part - old[0], here[1] * rest + there[1] * part - old[1]
    z = here[2] * rest + there[2] * part - old[2]
    way[0] += share * scale * (x * cos + z * sin)
    way[1] += share * scale * y
    way[2] += share * scale * (z * cos - x * sin)
    x, y, z = _turn_since(old, here, there, 3, rest, part)
    way[3] += share * (x * cos + z * sin)
    way[4] += share * y
    way[5] += share * (z * cos - x * sin)
    x, y, z = _turn_since(old, here, there, 7, rest, part)
    way[6] += share * x
    way[7] += share * y
    way[8] += share * z


@kernel
def _turn_since(p, q, r, at, rest, part):
    """Nearly the rotation vector from one quaternion to another between two, for turns that are not large.

    They begin at ``at`` in what is given.
    """
    a, b, c, d = p[at], p[at + 1], p[at + 2], p[at + 3]
    e, f = q[at] * rest + r[at] * part, q[at + 1] * rest + r[at + 1] * part
    g, h = q[at + 2] * rest + r[at + 2] * part, q[at + 3] * rest + r[at + 3] * part
    double = 2.0 if e * a + f * b + g * c + h * d >= 0.0 else -2.0
    return (
        double * (f * a - e * b - g * d + h * c),
        double * (g * a - e * c - h * b + f * d),
        double * (h * a - e * d - f * c + g * b),
    )


@kernel
def _turn_by(q, x, y, z):
    """Turn a quaternion by a rotation vector of the frame that it is given in, in place."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return
    s, c = math.sin(0.5 * angle) / angle, math.cos(0.5 * angle)
    x, y, z = x * s, y * s, z * s
    a, b, d, e = q[0], q[1], q[2], q[3]
    q[0] = c * a - x * b - y * d - z * e
    q[1] = c * b + x * a + y * e - z * d
    q[2] = c * d - x * e + y * a + z * b
    q[3] = c * e + x * d - y * b + z * a


@kernel
def _stand_weights(stands, n, foot, at, time, swing, near):
    """The stands before and after a time: their numbers and weights, and the first that is not yet over.

    In a stand its weight is 1. Away from stands a weight fades over ``swing``; between two that are not further than
    ``near`` apart one passes into the other.
    """
    count = stands.counts[n, foot]
    while at < count and stands.spans[n, foot, at, 1] < time:
        at += 1
    if at < count and stands.spans[n, foot, at, 0] <= time:
        return at, 1.0, -1, 0.0, at
    one, other, since, until = -1, -1, math.inf, math.inf
    if at > 0:
        one, since = at - 1, time - stands.spans[n, foot, at - 1, 1]
    if at < count:
        other, until = at, stands.spans[n, foot, at, 0] - time
    before, after = _ease(1.0 - since / swing), _ease(1.0 - until / swing)
    if since + until < near:
        passed = _ease(since / (since + until))
        before, after = before * (1.0 - passed), after * passed
    return one, before, other, after, at


@kernel
def _rotate(q, x, y, z):
    """Turn a vector by a quaternion."""
    tx = 2.0 * (q[2] * z - q[3] * y)
    ty = 2.0 * (q[3] * x - q[1] * z)
    tz = 2.0 * (q[1] * y - q[2] * x)
    return (
        x + q[0] * tx + q[2] * tz - q[3] * ty,
        y + q[0] * ty + q[3] * tx - q[1] * tz,
        z + q[0] * tz + q[1] * ty - q[2] * tx,
    )


@kernel
def _multiply(a, b, out):
    """Write the product of two quaternions; out may be one of them."""
    w = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    x = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    y = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    z = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@kernel
def _pose_chain(limbs, scale, root, rotations, places, turns):
    """Places and turns in the world of the joints of a chain."""
    for at in range(limbs.chain.shape[0]):
        j = limbs.chain[at]
        p = limbs.parents[j]
        if p < 0:
            for k in range(3):
                places[j, k] = root[k]
            for k in range(4):
                turns[j, k] = rotations[j, k]
        else:
            o = limbs.offsets[j]
            x, y, z = _rotate(turns[p], o[0] * scale, o[1] * scale, o[2] * scale)
            places[j, 0], places[j, 1], places[j, 2] = places[p, 0] + x, places[p, 1] + y, places[p, 2] + z
            a, b, c, d = turns[p, 0], turns[p, 1], turns[p, 2], turns[p, 3]
            e, f, g, h = rotations[j, 0], rotations[j, 1], rotations[j, 2], rotations[j, 3]
            turns[j, 0] = a * e - b * f - c * g - d * h
            turns[j, 1] = a * f + b * e + c * h - d * g
            turns[j, 2] = a * g - b * h + c * e + d * f
            turns[j, 3] = a * h + b * g - c * f + d * e


@kernel
def _beyond(now, wanted, longest, width):
    """How far a limb that is ``now`` long is asked beyond its length; it begins a little before, without a corner."""
    edge = longest - 1.5 * width
    return width * (_soft((wanted - edge) / width) - _soft((now - edge) / width))


@kernel
def _flexion(a, b, distance):
    """Flexion at which two bones have their ends so far apart."""
    cosine = (distance * distance - a * a - b * b) / (2.0 * a * b)
    return math.acos(min(max(cosine, -1.0), 1.0))


@kernel
def bend_limb(limbs, side, rotations, places, turns, tx, ty, tz, distance, bend, swing, spare):
    """Bend a limb until its end is ``distance`` from its upper joint, and swing it to point at a target.

    It bends in the plane that it is bent in, about its hinge where it is nearly straight, and not beyond ``MOST``, or
    what it is bent already. The swing is the shortest turn. Local rotations of its upper and middle joint change, and
    of its end joint, which keeps its turn in the world. A limb with no direction to point in stays as it is.

    Args:
        limbs: A ``motion.Limbs``.
        side: Which of the two.
        rotations: Local rotations. Shape (J, 4), changed.
        places: Places of the joints in the world [m]. Shape (J, 3).
        turns: Turns of the joints in the world. Shape (J, 4).
        tx: Where the target is [m].
        ty: Likewise.
        tz: Likewise.
        distance: How far the end is from the upper joint afterwards [m].
        bend: Room for a quaternion. Shape (4,).
        swing: Likewise.
        spare: Likewise.
    """
    upper, middle, end = limbs.joints[side, 0], limbs.joints[side, 1], limbs.joints[side, 2]
    p, q, r = places[upper], places[middle], places[end]
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = r[0] - q[0], r[1] - q[1], r[2] - q[2]
    a = math.sqrt(ux * ux + uy * uy + uz * uz)
    b = math.sqrt(vx * vx + vy * vy + vz * vz)
    now = math.sqrt((r[0] - p[0]) ** 2 + (r[1] - p[1]) ** 2 + (r[2] - p[2]) ** 2)
    flexion = _flexion(a, b, now)
    change = min(_flexion(a, b, distance), max(MOST, flexion)) - flexion
    # The axis that it is bent about; the hinge takes over where it is nearly straight.
    nx, ny, nz = (uy * vz - uz * vy) / (a * b), (uz * vx - ux * vz) / (a * b), (ux * vy - uy * vx) / (a * b)
    h = limbs.hinges[side]
    hx, hy, hz = _rotate(turns[upper], h[0], h[1], h[2])
    along = (hx * ux + hy * uy + hz * uz) / (a * a)
    hx, hy, hz = hx - along * ux, hy - along * uy, hz - along * uz
    size = math.sqrt(hx * hx + hy * hy + hz * hz)
    if size > 1e-6:
        hx, hy, hz = hx / size, hy / size, hz / size
        more = max(0.0, 0.2 - math.sqrt(nx * nx + ny * ny + nz * nz))
        nx, ny, nz = nx + more * hx, ny + more * hy, nz + more * hz
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    if size < 1e-9:
        nx, ny, nz = hx, hy, hz
    else:
        nx, ny, nz = nx / size, ny / size, nz / size
    wanted = flexion + change
    for _ in range(5):
        # Where the axis is not quite square to the limb, the turn that gives the distance is found step by step.
        c, s = math.cos(0.5 * change), math.sin(0.5 * change)
        bend[0], bend[1], bend[2], bend[3] = c, s * nx, s * ny, s * nz
        ex, ey, ez = _rotate(bend, vx, vy, vz)
        ex, ey, ez = ux + ex, uy + ey, uz + ez
        size = math.sqrt(ex * ex + ey * ey + ez * ez)
        lack = wanted - _flexion(a, b, size)
        change += lack
        if abs(lack) < 1e-9:
            break
    gx, gy, gz = tx - p[0], ty - p[1], tz - p[2]
    far = math.sqrt(gx * gx + gy * gy + gz * gz)
    if size < 1e-9 or far < 1e-9:
        return
    ex, ey, ez, gx, gy, gz = ex / size, ey / size, ez / size, gx / far, gy / far, gz / far
    w, x, y, z = 1.0 + ex * gx + ey * gy + ez * gz, ey * gz - ez * gy, ez * gx - ex * gz, ex * gy - ey * gx
    size = math.sqrt(w * w + x * x + y * y + z * z)
    if size < 1e-6:
        return
    swing[0], swing[1], swing[2], swing[3] = w / size, x / size, y / size, z / size
    # The upper joint swings; all between it and the middle joint goes along, and the middle joint bends in it.
    _into_parent(limbs, turns, upper, swing, spare, rotations, False)
    _multiply(swing, bend, bend)
    _into_parent(limbs, turns, middle, bend, swing, rotations, True)
    spare[0], spare[1], spare[2], spare[3] = 1.0, 0.0, 0.0, 0.0
    _into_parent(limbs, turns, end, spare, bend, rotations, True)


@kernel
def _into_parent(limbs, turns, joint, after, before, rotations, moved):
    """Write a joint's local rotation: it turns by ``after`` in the world, its parent, if ``moved``, by ``before``."""
    p = turns[limbs.parents[joint]]
    a, b, c, d = p[0], p[1], p[2], p[3]
    if moved:
        q = before
        a, b, c, d = (
            q[0] * p[0] - q[1] * p[1] - q[2] * p[2] - q[3] * p[3],
            q[0] * p[1] + q[1] * p[0] + q[2] * p[3] - q[3] * p[2],
            q[0] * p[2] - q[1] * p[3] + q[2] * p[0] + q[3] * p[1],
            q[0] * p[3] + q[1] * p[2] - q[2] * p[1] + q[3] * p[0],
        )
    q, o = after, turns[joint]
    e, f, g, h = (
        q[0] * o[0] - q[1] * o[1] - q[2] * o[2] - q[3] * o[3],
        q[0] * o[1] + q[1] * o[0] + q[2] * o[3] - q[3] * o[2],
        q[0] * o[2] - q[1] * o[3] + q[2] * o[0] + q[3] * o[1],
        q[0] * o[3] + q[1] * o[2] - q[2] * o[1] + q[3] * o[0],
    )
    w = a * e + b * f + c * g + d * h
    x = a * f - b * e - c * h + d * g
    y = a * g + b * h - c * e - d * f
    z = a * h - b * g + c * f - d * e
    size = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    out = rotations[joint]
    out[0], out[1], out[2], out[3] = w * size, x * size, y * size, z * size


@kernel
def _mix(a, b, share, out):
    """Write a quaternion between two."""
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    other = share if dot >= 0.0 else -share
    w, x, y, z = (
        a[0] * (1.0 - share) + b[0] * other,
        a[1] * (1.0 - share) + b[1] * other,
        a[2] * (1.0 - share) + b[2] * other,
        a[3] * (1.0 - share) + b[3] * other,
    )
    size = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    out[0], out[1], out[2], out[3] = w * size, x * size, y * size, z * size


@kernel
def plant_feet(
    first,
    stop,
    columns,
    times,
    frames,
    fractions,
    grounds,
    m,
    cuts,
    stands,
    falls,
    rate,
    scales,
    speeds,
    legs,
    how,
    roots,
    rotations,
):
    """Bring planted feet of avatars ``first`` to ``stop`` of ``columns`` to where they belong, in place.

    Args:
        first: First place in ``columns``.
        stop: One past the last.
        columns: Column of each avatar in the window. Shape (n,).
        times: Shape (T, n) or (T, 1) [s].
        frames: Playback frame at each time; -1 while absent. Shape (T, n), int32.
        fractions: How far on to the next frame. Shape (T, n).
        grounds: Ground transform at each time. Shape (T, n, 3).
        m: The frames, a ``motion.Frames``.
        cuts: A ``window.Cuts``.
        stands: A ``window.Stands``.
        falls: A ``window.Falls``.
        rate: Control frames a second.
        scales: Body size by column.
        speeds: Motion frames in a control frame, by column.
        legs: A ``motion.Limbs``.
        how: Furthest time that a cut moves feet from [s]; time to let go of a foot [s]; time between stands over which
            one passes into the next [s]; how far feet are moved from where blends have them before they are moved less,
            and at the most [m]; furthest that the pelvis goes down [m]; least flexion of a knee [rad]; length of a leg
            over which it begins to be short [1]; height over which soles ease onto the floor, and how far they may be
            under it, as feet that stand still in cleaned capture are [m].
        roots: Places of the roots [m]. Shape (T, n, 3), changed.
        rotations: Local rotations. Shape (T, n, J, 4), changed.
    """
    wide, swing, near, free, most, down, least, slack, floor, under = how
    joints = legs.parents.shape[0]
    places, turns = np.empty((joints, 3)), np.empty((joints, 4))
    asked, ankle = np.empty((2, 3)), np.empty((2, 3))
    shift, own, turned, other_turned = np.empty(3), np.empty(4), np.empty((2, 4)), np.empty((2, 4))
    firm, at = np.empty(2), np.empty(2, np.int64)
    now, longest = np.empty(2), np.empty(2)
    bend, turn, spare, way_on = np.empty(4), np.empty(4), np.empty(4), np.empty(9)
    shared = times.shape[1] == 1
    for i in range(first, stop):
        n = columns[i]
        scale, pace = scales[n], speeds[n] * m.rate
        low = cuts.starts[n]
        at[:] = 0
        for t in range(frames.shape[0]):
            frame = frames[t, i]
            if frame < 0:
                continue
            time = times[t, 0 if shared else i]
            while low < cuts.starts[n + 1] and cuts.times[low] <= time - wide:
                low += 1
            high = low
            while high < cuts.starts[n + 1] and cuts.times[high] < time + wide:
                high += 1
            root, pose = roots[t, i], rotations[t, i]
            _pose_chain(legs, scale, root, pose, places, turns)
            part = fractions[t, i]
            rest, further = 1.0 - part, frame + 1 if part > 0.0 else frame
            lack = 0.0
            for f in range(2):
                one, before, other, after, at[f] = _stand_weights(stands, n, f, at[f], time, swing, near)
                # Away from cuts feet are where they are captured.
                firm[f] = before + after if high > low else 0.0
                upper, middle, end = places[legs.joints[f, 0]], places[legs.joints[f, 1]], legs.joints[f, 2]
                for k in range(3):
                    ankle[f, k] = places[end, k]
                    asked[f, k] = places[end, k]
                o = legs.holds[f]
                if firm[f] > 0.0:
                    x, y, z = _rotate(turns[end], o[0] * scale, o[1] * scale, o[2] * scale)
                    hold_x, hold_y, hold_z = places[end, 0] + x, places[end, 1] + y, places[end, 2] + z
                    # The foot's own turn, and that of its toes.
                    _mix(m.feet[frame, f], m.feet[further, f], part, own)
                    c, d = math.cos(0.5 * grounds[t, i, 2]), math.sin(0.5 * grounds[t, i, 2])
                    turned[0, 0], turned[0, 1] = c * own[0] - d * own[2], c * own[1] + d * own[3]
                    turned[0, 2], turned[0, 3] = c * own[2] + d * own[0], c * own[3] - d * own[1]
                    toe = legs.toes[f]
                    if toe >= 0:
                        _mix(m.rotations[frame, toe], m.rotations[further, toe], part, turned[1])
                    shift[:] = 0.0
                    other_turned[:] = turned
                    if before > 0.0:
                        begin, ends = stands.spans[n, f, one, 0], stands.spans[n, f, one, 1]
                        _add_shift(m, cuts, falls, low, high, f, rate, pace, scale, time, begin, ends, before,
                                   shift, turned[0], turned[1], way_on)  # fmt: skip
                    if after > 0.0:
                        begin, ends = stands.spans[n, f, other, 0], stands.spans[n, f, other, 1]
                        _add_shift(m, cuts, falls, low, high, f, rate, pace, scale, time, begin, ends, after,
                                   shift, other_turned[0], other_turned[1], way_on)  # fmt: skip
                    here, there = m.holds[frame, f], m.holds[further, f]
                    x = (here[0] * rest + there[0] * part) * scale
                    y = (here[1] * rest + there[1] * part) * scale
                    z = (here[2] * rest + there[2] * part) * scale
                    cos, sin = math.cos(grounds[t, i, 2]), math.sin(grounds[t, i, 2])
                    shift[0] += firm[f] * (grounds[t, i, 0] + x * cos + z * sin - hold_x)
                    shift[1] += firm[f] * (y - hold_y)
                    shift[2] += firm[f] * (grounds[t, i, 1] - x * sin + z * cos - hold_z)
                    # Where cuts pile up feet come along before legs get out of shape.
                    way = math.sqrt(shift[0] * shift[0] + shift[1] * shift[1] + shift[2] * shift[2]) / scale
                    if way > free:
                        kept = (free + (most - free) * math.tanh((way - free) / (most - free))) / way
                        for k in range(3):
                            shift[k] *= kept
                    hold_x, hold_y, hold_z = hold_x + shift[0], hold_y + shift[1], hold_z + shift[2]
                    for k in range(2 if toe >= 0 else 1):
                        _mix(turned[k], other_turned[k], after / (before + after), turned[k])
                    _mix(turns[end], turned[0], firm[f], turns[end])
                    if toe >= 0:
                        _mix(pose[toe], turned[1], firm[f], pose[toe])
                    x, y, z = _rotate(turns[end], o[0] * scale, o[1] * scale, o[2] * scale)
                    asked[f, 0], asked[f, 1], asked[f, 2] = hold_x - x, hold_y - y, hold_z - z
                # No sole under the floor: heel and ball ease onto it.
                lowest = math.inf
                for end_of_sole in range(2):
                    o = legs.points[f, end_of_sole]
                    lowest = min(lowest, _rotate(turns[end], o[0] * scale, o[1] * scale, o[2] * scale)[1])
                lowest += asked[f, 1] + under * scale
                if lowest < 20.0 * floor * scale:
                    asked[f, 1] += floor * scale * _soft(-lowest / (floor * scale))
                a = math.sqrt((middle[0] - upper[0]) ** 2 + (middle[1] - upper[1]) ** 2 + (middle[2] - upper[2]) ** 2)
                b = math.sqrt(
                    (ankle[f, 0] - middle[0]) ** 2 + (ankle[f, 1] - middle[1]) ** 2 + (ankle[f, 2] - middle[2]) ** 2
                )
                now[f] = math.sqrt(
                    (ankle[f, 0] - upper[0]) ** 2 + (ankle[f, 1] - upper[1]) ** 2 + (ankle[f, 2] - upper[2]) ** 2
                )
                longest[f] = math.sqrt(a * a + b * b + 2.0 * a * b * math.cos(least))
                wanted = math.sqrt(
                    (asked[f, 0] - upper[0]) ** 2 + (asked[f, 1] - upper[1]) ** 2 + (asked[f, 2] - upper[2]) ** 2
                )
                over = _beyond(now[f], wanted, longest[f], slack * (a + b))
                lack += over * wanted / max(upper[1] - asked[f, 1], 0.5 * wanted)
            drop = down * scale * math.tanh(lack / (down * scale))
            root[1] -= drop
            for f in range(2):
                for k in range(3):
                    places[legs.joints[f, k], 1] -= drop
                upper, end = places[legs.joints[f, 0]], places[legs.joints[f, 2]]
                x, y, z = asked[f, 0], asked[f, 1], asked[f, 2]
                if firm[f] == 0.0 and abs(x - end[0]) + abs(y - end[1]) + abs(z - end[2]) < 1e-7:
                    continue
                wanted = math.sqrt((x - upper[0]) ** 2 + (y - upper[1]) ** 2 + (z - upper[2]) ** 2)
                distance = wanted - _beyond(now[f], wanted, longest[f], 0.001 * longest[f])
                bend_limb(legs, f, pose, places, turns, x, y, z, distance, bend, turn, spare)


@kernel
def _turn_in_world(limbs, turns, joint, x, y, z, rotations):
    """Turn a joint by a rotation vector of the world, in its local rotation."""
    x, y, z = _unrotate(turns[limbs.parents[joint]], x, y, z)
    _turn_by(rotations[joint], x, y, z)


@kernel
def _unrotate(q, x, y, z):
    """Turn a vector back by a quaternion."""
    tx = 2.0 * (q[3] * y - q[2] * z)
    ty = 2.0 * (q[1] * z - q[3] * x)
    tz = 2.0 * (q[2] * x - q[1] * y)
    return (
        x + q[0] * tx - q[2] * tz + q[3] * ty,
        y + q[0] * ty - q[3] * tx + q[1] * tz,
        z + q[0] * tz - q[1] * ty + q[2] * tx,
    )


@kernel
def _lean_at(landings, n, time, within, lean):
    """Write how a trunk leans at a time into ``lean``: four turns and the way of the pelvis; whether it does at all.

    Bumps that overlap do not add: between strikes one lean passes into the other.
    """
    lean[:] = 0.0
    rest, whole = 1.0, 0.0
    for strike in range(landings.starts[n], landings.starts[n + 1]):
        apart = time - landings.times[strike]
        span = landings.lean_spans[strike, 0] if apart < 0.0 else landings.lean_spans[strike, 1]
        weight = _ease(1.0 - abs(apart) / span)
        if weight > 0.0 and abs(apart) <= within:
            rest *= 1.0 - weight
            square = weight * weight
            whole += square
            for k in range(4):
                for j in range(3):
                    lean[k, j] += square * landings.turns[strike, k, j]
            for j in range(3):
                lean[4, j] += square * landings.moves[strike, j]
    if whole <= 0.0:
        return False
    share = (1.0 - rest) / whole
    for k in range(5):
        for j in range(3):
            lean[k, j] *= share
    return True


@kernel
def _move_pelvis(legs, scale, lean, least, root, pose, places, turns, ankles, bend, turn, spare):
    """Move the root by ``lean[4]`` over feet that stay where they are."""
    _pose_chain(legs, scale, root, pose, places, turns)
    for f in range(2):
        for k in range(3):
            ankles[f, k] = places[legs.joints[f, 2], k]
    for j in range(legs.parents.shape[0]):
        for k in range(3):
            places[j, k] += lean[4, k]
    for k in range(3):
        root[k] += lean[4, k]
    for f in range(2):
        p, q, r = places[legs.joints[f, 0]], places[legs.joints[f, 1]], places[legs.joints[f, 2]]
        a = math.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2)
        b = math.sqrt((r[0] - q[0]) ** 2 + (r[1] - q[1]) ** 2 + (r[2] - q[2]) ** 2)
        now = math.sqrt((r[0] - p[0]) ** 2 + (r[1] - p[1]) ** 2 + (r[2] - p[2]) ** 2)
        longest = math.sqrt(a * a + b * b + 2.0 * a * b * math.cos(least))
        x, y, z = ankles[f, 0], ankles[f, 1], ankles[f, 2]
        wanted = math.sqrt((x - p[0]) ** 2 + (y - p[1]) ** 2 + (z - p[2]) ** 2)
        distance = wanted - _beyond(now, wanted, longest, 0.002 * longest)
        bend_limb(legs, f, pose, places, turns, x, y, z, distance, bend, turn, spare)


@kernel
def carry_fists(first, stop, columns, times, landings, scales, arms, legs, leaning, least, within, roots, rotations):
    """Carry fists of avatars ``first`` to ``stop`` of ``columns`` onto what they hit, in place.

    Args:
        first: First place in ``columns``.
        stop: One past the last.
        columns: Column of each avatar in the window. Shape (n,).
        times: Shape (T, n) or (T, 1) [s].
        landings: A ``fists.Landings``.
        scales: Body size by column.
        arms: A ``motion.Limbs``.
        legs: Likewise.
        leaning: Joints that lean, see ``leans.leaning_joints``. Shape (4,).
        least: Least flexion of elbows and knees [rad]. Shape (2,).
        within: Time beyond which the trunk does not lean for a strike [s].
        roots: Places of the roots [m]. Shape (T, n, 3), changed.
        rotations: Local rotations. Shape (T, n, J, 4), changed.
    """
    joints = arms.parents.shape[0]
    places, turns = np.empty((joints, 3)), np.empty((joints, 4))
    shifts, weights, targets, ankles = np.empty((2, 3)), np.empty(2), np.empty((2, 3)), np.empty((2, 3))
    lean, bend, turn, spare = np.empty((5, 3)), np.empty(4), np.empty(4), np.empty(4)
    shared = times.shape[1] == 1
    for i in range(first, stop):
        n = columns[i]
        scale = scales[n]
        for t in range(times.shape[0]):
            time = times[t, 0 if shared else i]
            if not math.isfinite(roots[t, i, 0]):
                continue
            weights[:] = 0.0
            shifts[:] = 0.0
            for strike in range(landings.starts[n], landings.starts[n + 1]):
                apart = time - landings.times[strike]
                span = landings.spans[strike, 0] if apart < 0.0 else landings.spans[strike, 1]
                weight = _ease(1.0 - abs(apart) / span)
                if weight > 0.0:
                    hand = landings.hands[strike]
                    weights[hand] += weight
                    for k in range(3):
                        shifts[hand, k] += weight * landings.shifts[strike, k]
            leans = _lean_at(landings, n, time, within, lean)
            root, pose = roots[t, i], rotations[t, i]
            if weights[0] > 0.0 or weights[1] > 0.0:
                _pose_chain(arms, scale, root, pose, places, turns)
                for hand in range(2):
                    end, o = arms.joints[hand, 2], arms.points[hand, 0]
                    x, y, z = _rotate(turns[end], o[0] * scale, o[1] * scale, o[2] * scale)
                    targets[hand, 0] = places[end, 0] + x
                    targets[hand, 1] = places[end, 1] + y
                    targets[hand, 2] = places[end, 2] + z
            if leans:
                if lean[4, 0] != 0.0 or lean[4, 1] != 0.0 or lean[4, 2] != 0.0:
                    _move_pelvis(legs, scale, lean, least[1], root, pose, places, turns, ankles, bend, turn, spare)
                for k in range(4):
                    if leaning[k] >= 0:
                        _turn_by(pose[leaning[k]], lean[k, 0], lean[k, 1], lean[k, 2])
            if weights[0] <= 0.0 and weights[1] <= 0.0:
                continue
            _pose_chain(arms, scale, root, pose, places, turns)
            for hand in range(2):
                weight = min(weights[hand], 1.0)
                if weight <= 0.0:
                    continue
                p, q, r = places[arms.joints[hand, 0]], places[arms.joints[hand, 1]], places[arms.joints[hand, 2]]
                o = arms.points[hand, 0]
                # As far as it is free to, the fist goes along with the trunk.
                x, y, z = _rotate(turns[arms.joints[hand, 2]], o[0] * scale, o[1] * scale, o[2] * scale)
                x = r[0] + weight * (targets[hand, 0] - r[0] - x) + shifts[hand, 0]
                y = r[1] + weight * (targets[hand, 1] - r[1] - y) + shifts[hand, 1]
                z = r[2] + weight * (targets[hand, 2] - r[2] - z) + shifts[hand, 2]
                a = math.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2)
                b = math.sqrt((r[0] - q[0]) ** 2 + (r[1] - q[1]) ** 2 + (r[2] - q[2]) ** 2)
                now = math.sqrt((r[0] - p[0]) ** 2 + (r[1] - p[1]) ** 2 + (r[2] - p[2]) ** 2)
                longest = math.sqrt(a * a + b * b + 2.0 * a * b * math.cos(least[0]))
                wanted = math.sqrt((x - p[0]) ** 2 + (y - p[1]) ** 2 + (z - p[2]) ** 2)
                shortest = math.sqrt(a * a + b * b + 2.0 * a * b * math.cos(FOLDED))
                distance = wanted - _beyond(now, wanted, longest, 0.0015 * (a + b))
                distance += _beyond(-now, -wanted, -shortest, 0.01 * (a + b))
                bend_limb(arms, hand, pose, places, turns, x, y, z, distance, bend, turn, spare)


@kernel
def show_blows(first, stop, columns, times, blows, trunk, peak, length, recent, roots, rotations):
    """Lay reactions over poses of avatars ``first`` to ``stop`` of ``columns``, in place.

    A spring's answer to a blow is 1 at its highest, ``peak`` seconds after it, swings through a little, and is at rest
    after ``length`` seconds.

    Args:
        first: First place in ``columns``.
        stop: One past the last.
        columns: Column of each avatar in the window. Shape (n,).
        times: Shape (T, n) or (T, 1) [s].
        blows: A ``reactions.Blows``.
        trunk: A ``reactions.Trunk``.
        peak: See above.
        length: See above.
        recent: Time after which a blow is left out [s].
        roots: Places of the roots. Shape (T, n, 3).
        rotations: Local rotations. Shape (T, n, J, 4), changed.
    """
    joints = trunk.parents.shape[0]
    turns, spin = np.empty((joints, 4)), np.empty((2, 3))
    shared = times.shape[1] == 1
    for i in range(first, stop):
        n = columns[i]
        for t in range(times.shape[0]):
            time = times[t, 0 if shared else i]
            if not math.isfinite(roots[t, i, 0]):
                continue
            active = False
            spin[:] = 0.0
            for blow in range(blows.starts[n], blows.starts[n + 1]):
                since = time - blows.times[blow]
                if not 0.0 < since < min(length, recent):
                    continue
                active = True
                s = since / peak
                back = min(max((since - 2.5 * peak) / (length - 2.5 * peak), 0.0), 1.0)
                answer = s * s * s * math.exp(3.0 - 3.0 * s) - 0.12 * math.sin(math.pi * back) ** 2
                answer *= _ease((length - since) / (0.4 * length))
                for k in range(3):
                    spin[blows.parts[blow], k] += answer * blows.axes[blow, k]
            if not active:
                continue
            pose = rotations[t, i]
            for at in range(trunk.chain.shape[0]):
                j = trunk.chain[at]
                head, torso = trunk.gives[at, 0], trunk.gives[at, 1]
                p = trunk.parents[j]
                if p >= 0 and head + torso > 0.0:
                    _turn_in_world(trunk, turns, j, head * spin[0, 0] + torso * spin[1, 0],
                                   head * spin[0, 1] + torso * spin[1, 1], head * spin[0, 2] + torso * spin[1, 2],
                                   pose)  # fmt: skip
                if p < 0:
                    for k in range(4):
                        turns[j, k] = pose[j, k]
                else:
                    _multiply(turns[p], pose[j], turns[j])
