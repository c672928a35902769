"""Control, slow and plain: one avatar after another, one frame after another, straight from the definitions."""

import math
from functools import lru_cache
from itertools import product
from types import SimpleNamespace

import naive_defence
import naive_ground as ground
import numpy as np
from naive_legs import crosses_legs
from naive_opponents import nearest, neighbours
from naive_policy import action_values, move_of
from naive_strikes import at, ball, gap_to, thrown, tolerance_of, what_is_seen

from crowdsim.crowd.kernels.advance import NEARLY
from crowdsim.crowd.kernels.choose import BURSTS, REDRAWN
from crowdsim.crowd.kernels.intents import CLOSEST, SHYNESS
from crowdsim.crowd.kernels.layout import BLOCKED, FORESEEN, LANDED
from crowdsim.crowd.kernels.observe import AT_HAND, WALKS
from crowdsim.crowd.kernels.opponents import AVERTED, BEHIND, ENGAGED, HIT, REMEMBERED
from crowdsim.crowd.kernels.resolve import FOOT
from crowdsim.crowd.kernels.resolve import GUARDED as LET_THROUGH
from crowdsim.crowd.kernels.shown_motion import CELL, LATEST, NONE
from crowdsim.crowd.kernels.terms import variety
from crowdsim.crowd.kernels.terms.aim import AIM, AIMED, DEPTH, SET_UP
from crowdsim.crowd.kernels.terms.collision_avoidance import BYSTANDERS, FURTHEST, HALTED, LIGHT, PUSHED, STEP
from crowdsim.crowd.kernels.terms.facing import FROM, THRONG, TURNED
from crowdsim.crowd.kernels.terms.facing import NEAR as FACED
from crowdsim.crowd.kernels.terms.guard import DROPPED
from crowdsim.crowd.kernels.terms.guard import NEAR as GUARDED
from crowdsim.crowd.kernels.terms.stance import ASTRAY
from crowdsim.crowd.kernels.terms.stillness import BESIDE, CALM, FACING
from crowdsim.crowd.kernels.terms.strikes import AT_HAND as REACHED
from crowdsim.crowd.kernels.terms.strikes import AWAY, BOLDNESS, NEAR, REST, SHORT
from crowdsim.crowd.kernels.terms.stunned import LONGEST, STUNS
from crowdsim.crowd.kernels.vetoes.crossed_legs import CROSSED
from crowdsim.crowd.kernels.vetoes.same_strike import TOGETHER, TWICE
from crowdsim.crowd.kernels.vetoes.strike_at_air import AIR
from crowdsim.crowd.model import AT_REST, FULL_REACH, STRONG
from crowdsim.crowd.model_guard import AROUND, HANGS, LATER, LEAST
from crowdsim.crowd.model_stillness import STILL
from crowdsim.crowd.model_tables import BRAKING
from crowdsim.crowd.random import Purpose, uniform
from crowdsim.crowd.script import target_positions
from crowdsim.crowd.stances import stance_actions
from crowdsim.motion.ground import wrap
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.strikers import LEGS
from crowdsim.policy.axes.axis import UNSEEN_STRIKE


def once(function):
    """Let a function work out only once what it says of an object, which stays in memory as long as that is known."""
    known = {}

    def remembered(one):
        if id(one) not in known:
            known[id(one)] = one, function(one)
        return known[id(one)][1]

    return remembered


class Avatar:
    """An avatar, with the policy's own numbers for states and actions."""

    def __init__(self, number, crowd, policies):
        self.number, self.policy = number, policies[crowd.cast.policies[number]]
        cast = crowd.cast
        self.scale, self.speed = float(cast.scales[number]), float(cast.speeds[number])
        self.width = self.scale * float(cast.girths[number])
        self.team, self.skip, self.fixed = int(cast.teams[number]), int(crowd.skip[number]), int(crowd.fixed[number])
        self.cohort = int(crowd.cohort[number])
        actions, graph = self.policy.actions, self.policy.graph
        self.stance = int(cast.stances[number])
        self.astray = stance_actions(self.policy)[:, self.stance - 1] if self.stance else np.zeros(actions.state_count)
        self.calm = calm_shares(self.policy)
        self.unguarded = unguarded_times(self.policy)
        self.ways = ways_to_halt(actions)
        self.space = space_of(self.policy)
        with_entry = [s for s in range(actions.state_count) if (actions.next == s).any()]
        far = [float(np.hypot(*self.ways[s][1][:2])) for s in with_entry]
        with_entry = [s for s, brake in zip(with_entry, far, strict=True) if brake <= max(AT_REST, min(far))]
        with_entry = [s for s in with_entry if self.astray[s] == 0] or with_entry
        self.state = with_entry[int(float(uniform(crowd.seed, Purpose.START, number)) * len(with_entry))]
        into = [a for a in range(actions.action_count) if actions.next[a] == self.state]
        self.action = min(into, key=lambda a: (graph.action_costs[a], a))
        self.phase = self.phase_before = float(actions.lengths[self.action])
        end = np.array([crowd.x[number], crowd.z[number], crowd.heading[number]])
        self.start, self.halts = self.before_start(self.action, end), end
        self.action_before, self.start_before, self.decided = None, None, False
        self.opponent = self.opponent_before = -1
        self.decisions = 0
        self.burst, self.rested = 0, 0.0
        own = crowd.temperaments[number] if len(crowd.temperaments) else (1.0, 0.0, 0.0)
        self.slowness, self.doublings, self.range = own
        self.first_state = sum(other.actions.state_count for other in policies[: cast.policies[number]])
        self.shown, self.thrown, self.thrown_until = [], -1, 0
        self.hit_by, self.hit, self.hit_frame = -1, np.zeros(2), -math.inf
        self.seen = self.seen_before = None

    @property
    def length(self):
        return float(self.policy.actions.lengths[self.action])

    def place(self, action, phase):
        return self.policy.database.stride * (float(self.policy.graph.action_first[action]) - 1 + phase)

    @lru_cache(maxsize=1000)  # noqa: B019
    def displacement(self, action, phase):
        """Ground transform since the action's start, scaled."""
        rows = self.policy.database.ground
        moved = ground.compose(ground.inverse(rows[int(self.place(action, 0))]), at(rows, self.place(action, phase)))
        moved = ground.compose(self.policy.actions.shifts[action], moved)
        return moved * [self.scale, self.scale, 1.0]

    def before_start(self, action, end):
        """Where an action starts that ends in a place."""
        way = self.displacement(action, float(self.policy.actions.lengths[action]))
        heading = end[2] - way[2]
        start = ground.compose([0, 0, heading], way)
        return np.array([end[0] - start[0], end[1] - start[1], heading])

    def stands(self):
        return ground.compose(self.start, self.displacement(self.action, min(self.phase, self.length)))

    def end(self):
        """Where its action ends."""
        return ground.compose(self.start, self.displacement(self.action, self.length))

    def halt_of(self, action, start):
        """Where it can halt after an action."""
        _, way = _go_on(self.policy.actions, action, self.ways)
        return ground.compose(start, way * [self.scale, self.scale, 1.0])

    def meanwhile(self, share):
        """Action, phase and its start, interpolated by ``share`` to this frame."""
        shown = min(self.phase, self.length)
        if not self.decided:
            return self.action, self.phase_before + share * (shown - self.phase_before), self.start
        rest = float(self.policy.actions.lengths[self.action_before]) - self.phase_before
        moved = share * (rest + shown)
        if moved < rest:
            return self.action_before, self.phase_before + moved, self.start_before
        return self.action, moved - rest, self.start

    def body(self, name, action, phase, start):
        stands = ground.compose(start, self.displacement(action, phase))
        return ground.to_world(stands, at(getattr(self.policy.database, name), self.place(action, phase)) * self.scale)


@once
def calm_shares(policy):
    """Share of the frames of each action in which the joints are slow on the average."""
    database, graph = policy.database, policy.graph
    joints = sorted(set(database.body.roles.values()))

    def joints_at(frame):
        pose = database.root_positions[frame : frame + 1], database.rotations[frame : frame + 1]
        return forward_kinematics(database.skeleton, *pose)[0][0, joints]

    def still(frame):
        after = min(frame + 1, len(database.rotations) - 1)
        way = np.linalg.norm(joints_at(after) - joints_at(frame), axis=-1).mean()
        return way * database.playback_rate < STILL * database.body.height

    found = [still(frame * database.stride) for frame in range(database.frame_count)]
    spans = zip(graph.action_first, graph.action_lengths, strict=True)
    return np.array([np.mean(found[first : first + length]) for first, length in spans])


@once
def unguarded_times(policy):
    """How long hands hang in each action, and at least behind it, whose seconds count less and less."""
    database, actions, first = policy.database, policy.actions, policy.graph.action_first
    if not len(database.strike_frames):
        return np.zeros(actions.action_count)
    rate, count = database.playback_rate, len(database.fists)
    lower = [min(fists[:, 1]) - pelvis[1] for fists, pelvis in zip(database.fists, database.pelvises, strict=True)]
    fights = [f for f in range(count) if min(abs(f - strike) for strike in database.strike_frames) <= AROUND * rate]
    low = [height < HANGS * np.median([lower[f] for f in fights]) for height in lower]
    least = round(LEAST * rate)
    hangs = [
        any(all(low[k : k + least]) for k in range(max(f - least + 1, 0), min(f, count - least) + 1))
        for f in range(count)
    ]
    own = [
        sum(hangs[(first[a] + t) * database.stride] for t in range(actions.lengths[a])) / database.control_rate
        for a in range(actions.action_count)
    ]
    fades = LATER ** (actions.lengths / database.control_rate)
    behind = [0.0] * actions.state_count
    for _ in range(60):
        total = [own[a] + fades[a] * behind[actions.next[a]] for a in range(actions.action_count)]
        behind = [min(total[actions.offsets[s] : actions.offsets[s + 1]]) for s in range(actions.state_count)]
    return np.array([own[a] + fades[a] * behind[actions.next[a]] for a in range(actions.action_count)])


@once
def ways_to_halt(actions):
    """Ground transform, from each state, of where a body is that goes on as little as it can; a 0 before each."""
    ways = [(0.0, np.zeros(3))] * actions.state_count
    for _ in range(BRAKING):
        ways = [min((_go_on(actions, a, ways) for a in range(*actions.offsets[s : s + 2])), key=lambda way: way[0])
                for s in range(actions.state_count)]  # fmt: skip
    return [(0.0, way) for _, way in ways]


def _go_on(actions, action, ways):
    """How far an action and what comes after it lead, and where."""
    move, (far, way) = move_of(actions, action), ways[actions.next[action]]
    return float(np.hypot(*move[:2])) + far, ground.compose(move, way)


def outside(arena, x, z):
    kind, cx, cz, half_x, half_z = arena
    if kind == 1:
        return max(math.hypot(x - cx, z - cz) - half_x, 0.0)
    if kind == 2:
        return math.hypot(max(abs(x - cx) - half_x, 0.0), max(abs(z - cz) - half_z, 0.0))
    return 0.0


def nearest_approach(a, b):
    """Least distance from the origin to the line from a to b, and whether it lies behind a."""
    way = b - a
    square = float(way @ way)
    t = min(max(-float(a @ way) / square, 0.0), 1.0) if square > 0 else 0.0
    return float(np.hypot(*(a + t * way))), t


def run(crowd, policies, frames):
    """Return a record of frames and the strikes thrown, as ``simulation.Simulation`` does."""
    avatars = [Avatar(i, crowd, policies) for i in range(crowd.count)]
    record = {
        name: np.zeros((frames, crowd.count)) for name in ("action", "action_frame", "x", "z", "heading", "opponent")
    }
    strikes = []
    paths = crowd.targets
    marks = {}
    for frame in range(frames):
        for one in avatars:
            one.decided = False
            if frame > 0:
                one.phase_before = min(one.phase, one.length)
                one.phase = float(np.float32(one.phase + one.speed))  # phases are stored in single precision
                if one.length - NEARLY < one.phase < one.length:
                    one.phase = float(one.length)
        due = [one for one in avatars if one.phase >= one.length]
        targets = target_positions(paths, frame - 1, 2 + FORESEEN, policies[0].database.control_rate)
        chosen = [decide(one, avatars, crowd, targets, frame, marks) for one in due]
        bodies = [what_is_seen(one, opponent, avatars, targets) for one, (opponent, _) in zip(due, chosen, strict=True)]
        for one, seen in zip(due, bodies, strict=True):
            one.seen_before, one.seen = one.seen, seen
        for one, (opponent, action) in zip(due, chosen, strict=True):
            one.shown.append(twin_of(one, action))
            if one.policy.actions.strike_offsets[action] < one.policy.actions.strike_offsets[action + 1]:
                one.thrown = one.shown[-1]
                one.thrown_until = frame + int(one.policy.actions.lengths[action] / one.speed)
            for aside, onwards in product((-0.5, 0.5), repeat=2):
                marks[mark_of(one.stands(), one.shown[-1], crowd.count, aside, onwards)] = frame
            one.action_before, one.start_before, one.start = one.action, one.start, one.stands()
            one.halts = one.halt_of(action, one.start)
            if one.decisions == 0:  # whoever enters stands where they should
                shift = one.policy.actions.shifts[action] * [one.scale, one.scale, 1.0]
                one.start = ground.compose(one.start, ground.inverse(shift))
            one.phase = min(one.phase - one.length, one.speed)
            one.action, one.decided = action, True
            one.opponent_before, one.opponent = one.opponent, opponent
            one.decisions += 1
        now = [strike for one in avatars for strike in thrown(one, avatars, frame, targets)]
        note_hits(now, avatars, frame)
        strikes += now
        for one in avatars:
            stands = one.stands()
            row = (one.action, min(one.phase, one.length), stands[0], stands[1], wrap(stands[2]), one.opponent)
            for name, value in zip(record, row, strict=True):
                record[name][frame, one.number] = value
    return SimpleNamespace(**record, strikes=sorted(strikes))


def note_hits(strikes, avatars, frame):
    """Those who are hit, or block, remember whom: of several by the strongest, of equals by the lowest number."""
    found = {}
    for strike in strikes:
        attacker, victim, limb, outcome = *strike[1:4], strike[8]
        if outcome in (LANDED, BLOCKED) and victim >= 0:
            strong = np.percentile(avatars[attacker].policy.database.strike_speeds.astype(float), STRONG)
            mass = (FOOT if limb in LEGS else 1.0) * avatars[attacker].scale ** 3
            share = LET_THROUGH if outcome == BLOCKED else 1.0
            found.setdefault(victim, []).append((-strike[7] / strong * mass * share, attacker))
    for victim, hits in found.items():
        strength, attacker = min(hits)
        one, other = avatars[victim], avatars[attacker]
        way = (one.stands() - other.stands())[:2]
        one.hit_by, one.hit, one.hit_frame = attacker, -strength * way / np.hypot(*way), frame


def decide(one, avatars, crowd, targets, frame, marks):
    """Opponent and next action of one avatar, from what all are like now."""
    positions = np.array([other.stands() for other in avatars])
    x, z, team = positions[:, 0], positions[:, 1], np.array([other.team for other in avatars])
    mine = positions[one.number]
    near = neighbours(x, z, mine[0], mine[1], one.number, crowd.crowding.reach, crowd.crowding.most)
    if one.skip == -2:
        opponent = one.fixed
    else:
        opponent = nearest(x, z, team, mine[0], mine[1], one.number, one.skip)
        old = one.opponent
        if opponent >= 0:
            others = {opponent, *(j for j in near if team[j] != one.skip)}
            opponent = min(others, key=lambda j: (seems_far(one, avatars[j], frame), j))
            kept = seems_far(one, avatars[old], frame) - crowd.hysteresis[one.cohort] if old >= 0 else -math.inf
            if old >= 0 and team[old] != one.skip and seems_far(one, avatars[opponent], frame) >= kept:
                opponent = old
    target, moving, lasts, faces = None, np.zeros(2), 0.0, 0.0
    if opponent >= 0:
        other = avatars[opponent]
        faces = positions[opponent, 2]
        target = other.body("heads", other.action, min(other.phase, other.length), other.start)
        lasts = (other.length - min(other.phase, other.length)) / other.speed
        if lasts > 0:
            end = other.body("heads", other.action, other.length, other.start)
            moving = (end - target)[[0, 2]] / lasts
    elif opponent <= -2:
        ahead = meeting(one, mine, targets[1:, -2 - opponent])
        target = targets[1 + ahead, -2 - opponent]
        if ahead == 0:
            lasts, moving = math.inf, (target - targets[0, -2 - opponent])[[0, 2]]
        faces = math.atan2(*moving)
    interval = crowd.intervals[one.cohort] * one.slowness
    rests = interval > 0 and one.burst == 0 and frame < one.rested
    shift = one.range - SHYNESS * one.doublings
    if target is not None and rests and shift != 0:
        way = (target - [mine[0], 0.0, mine[1]])[[0, 2]]
        far = math.hypot(*way)
        target = target.copy()
        target[[0, 2]] = mine[:2] + way * max(far - shift, CLOSEST) / far
    if outside(crowd.arena, mine[0], mine[1]) > crowd.crowding.turn:
        target = np.array([crowd.arena[1], 1.5 * one.scale if target is None else target[1], crowd.arena[2]])
        moving, faces = np.zeros(2), faces if opponent >= 0 else 0.0
    policy, actions = one.policy, one.policy.actions
    state = int(actions.next[one.action])
    choices = range(actions.offsets[state], actions.offsets[state + 1])
    if target is None:
        values = -actions.costs[list(choices)].astype(float)
    else:
        weights = {b.name: crowd.weights[one.cohort, k] for k, b in enumerate(policy.behaviours)}
        reaction = crowd.reactions[one.cohort] if len(crowd.reactions) else 0
        strike, _ = naive_defence.sees(one, opponent, avatars, near, reaction)
        impact = UNSEEN_STRIKE if strike is None else strike[0] * one.speed
        place = within_grids(policy, ground.to_local(mine, target) / one.scale)
        seen = np.array([*place, faces - mine[2], impact])
        turned = ground.to_local([0, 0, mine[2]], np.array([moving[0], 0, moving[1]]))
        values = action_values(policy, weights, state, seen, turned / (one.scale * one.speed), lasts * one.speed)
    for k, action in enumerate(choices):
        values[k] -= crowding(one, action, mine, [avatars[j] for j in near], positions, crowd, opponent)
        values[k] += crowd.crowding.back * giving_way(one, action, mine, frame)
        values[k] -= crowd.crowding.stunned * strikes_while_stunned(one, action, frame)
    counts, apart = np.diff(actions.strike_offsets)[list(choices)], crowd.crowding.end > 0
    if opponent >= 0 and crowd.varieties[one.cohort] > 0:
        far = math.hypot(seen[0], seen[2])
        charge = crowd.varieties[one.cohort] * (variety.ONE_STANCE if one.stance else 1.0)
        ahead = seen[2] >= variety.FACING * far and far <= variety.NEAR
        for k, action in enumerate(choices):
            if ahead:
                values[k] -= charge * repetition(one, action, frame, marks, crowd.count)
    if target is not None and len(crowd.defences) and crowd.defences[one.cohort] > 0:
        values = values - naive_defence.costs(one, opponent, avatars, near, crowd)
    if interval > 0 and one.burst == 0 and not rests:
        least, most = BURSTS
        drawn = float(uniform(crowd.seed, Purpose.BURST, one.number, one.decisions))
        one.burst = least + int(drawn * (most - least + 1))
    worth = -REST if rests else BOLDNESS * one.doublings
    if opponent >= 0 and not rests:
        its = avatars[opponent].stands()
        close = math.hypot(*(its - mine)[:2]) < NEAR
        worth -= crowd.crowding.unseen * (close and facing(its, mine) < AWAY)
    values = values + worth * counts
    if opponent >= 0 and not rests and math.hypot(seen[0], seen[2]) > REACHED:
        short = [counts[k] > 0 and strikes_air(one, avatars[opponent], a, mine) for k, a in enumerate(choices)]
        values = values - SHORT * crowd.crowding.wasted * np.array(short)
    if opponent >= 0 and len(near) >= THRONG and apart and math.hypot(seen[0], seen[2]) <= FACED:
        values = values - TURNED * np.array([turned_away(one, a, seen, turned, lasts) for a in choices])
    if opponent <= -2 and crowd.crowding.wasted:
        values = values + aim(one, choices, mine, targets[1:, -2 - opponent], crowd)
    if opponent >= 0 and rests and FACING * math.hypot(seen[0], seen[2]) <= min(seen[2], FACING * BESIDE):
        values = values + CALM * one.calm[list(choices)]
    if opponent >= 0 and math.hypot(seen[0], seen[2]) <= GUARDED:
        values = values - DROPPED * one.unguarded[list(choices)]
    values = values - ASTRAY * one.astray[actions.next[list(choices)]]
    place = pick(values, one, crowd)
    varied = opponent >= 0 and crowd.varieties[one.cohort] > 0
    for _ in range(REDRAWN):
        if varied and counts[place] > 0 and throws_too(one, avatars[opponent], choices[place], frame):
            values[place] -= TWICE
            place = pick(values, one, crowd)
        elif apart and crosses_legs(one, choices[place], mine, [avatars[j] for j in near]):
            values[place] -= CROSSED
            place = pick(values, one, crowd)
        elif (
            crowd.crowding.wasted
            and opponent >= 0
            and counts[place]
            and strikes_air(one, avatars[opponent], choices[place], mine)
        ):
            values[place] -= crowd.crowding.wasted
            place = pick(values, one, crowd)
    if interval > 0:
        one.burst = max(one.burst - int(counts[place]), 0)
        one.rested = max(one.rested, frame) + interval * int(counts[place])
    return opponent, choices[place]


def seems_far(one, other, frame):
    """Distance of an opponent, and more when it is behind, looks away or fights someone else; less after a hit."""
    mine, its = one.stands(), other.stands()
    far = math.hypot(its[0] - mine[0], its[1] - mine[1])
    seems = far + BEHIND * 0.5 * (1.0 - facing(mine, its)) + AVERTED * 0.5 * (1.0 - facing(its, mine))
    seems += 0.0 if other.opponent == one.number else ENGAGED
    hit = one.hit_by == other.number and frame - one.hit_frame < REMEMBERED
    return seems - (HIT if hit else 0.0)


def meeting(one, mine, places):
    """In how many frames an avatar can meet a scripted target at a walk, that is not at hand."""
    for ahead, place in enumerate(places[:FORESEEN]):
        far = math.hypot(place[0] - mine[0], place[2] - mine[1])
        if far <= (AT_HAND + ahead * WALKS * one.speed) * one.scale:
            return ahead
    return FORESEEN


def aim(one, choices, mine, places, crowd):
    """What actions are worth by how soon a strike can land on a scripted target."""
    actions, found = one.policy.actions, np.zeros(len(choices))
    near = math.hypot(places[0][0] - mine[0], places[0][2] - mine[1]) <= AIMED * one.scale
    for k, action in enumerate(choices):
        if actions.strike_offsets[action] < actions.strike_offsets[action + 1]:
            found[k] = AIM if near and hits_ball(one, action, mine, 0, places) else -crowd.crowding.wasted
        elif near:
            found[k] = AIM * SET_UP * planned(one, action, mine, 0, places, DEPTH - 1)
    return found


def planned(one, action, stands, frames, places, more):
    """1 where a strike that follows an action lands, less for each of up to ``more`` actions in between."""
    actions = one.policy.actions
    length, state = int(actions.lengths[action]), int(actions.next[action])
    then, frames = ground.compose(stands, one.displacement(action, length)), frames + length
    following = range(actions.offsets[state], actions.offsets[state + 1])
    if any(hits_ball(one, after, then, frames, places) for after in following):
        return 1.0
    quiet = [after for after in following if actions.strike_offsets[after] == actions.strike_offsets[after + 1]]
    return max((SET_UP * planned(one, after, then, frames, places, more - 1) for after in quiet if more), default=0.0)


def hits_ball(one, action, stands, frames, places):
    """Whether the first strike of an action, begun somewhere in some frames, lands on a target along its path."""
    actions = one.policy.actions
    first = actions.strike_offsets[action]
    if first == actions.strike_offsets[action + 1]:
        return False
    point = ground.to_world(stands, actions.strike_positions[first].astype(float) * one.scale)
    when = (frames + float(actions.strike_times[first]) - min(one.phase - one.length, one.speed)) / one.speed
    if when > FORESEEN - 1.0:
        return False
    when = max(when, 0.0)
    share = when - int(when)
    there = (1.0 - share) * np.asarray(places[int(when)]) + share * np.asarray(places[int(when) + 1])
    return abs(gap_to(point, *ball(one, there))[0]) <= tolerance_of(one.policy) * one.scale


def strikes_air(one, other, action, mine):
    """Whether the first strike of an action ends further than ``AIR`` from the way of its opponent."""
    actions = one.policy.actions
    fist = actions.strike_positions[actions.strike_offsets[action]].astype(float) * one.scale
    point = ground.to_world(mine, fist)[[0, 2]]
    begin, end = other.stands()[:2], other.end()[:2]
    way = end - begin
    share = np.clip((point - begin) @ way / max(way @ way, 1e-12), 0.0, 1.0)
    return np.linalg.norm(point - begin - share * way) > AIR


def turned_away(one, action, seen, moving, lasts):
    """By how much the cosine of the opponent's bearing at the end of an action is less than ``FROM``."""
    length = float(one.policy.actions.lengths[action])
    way = one.displacement(action, length) / [one.scale, one.scale, 1.0]
    there = np.array([seen[0], seen[2]]) + moving[[0, 2]] / (one.scale * one.speed) * min(length, lasts * one.speed)
    return max(FROM - facing(way, there), 0.0)


def facing(ground_frame, other):
    """Cosine of the angle between where one looks and where the other is."""
    far = math.hypot(other[0] - ground_frame[0], other[1] - ground_frame[1])
    return ground.to_local(ground_frame, np.array([other[0], 0.0, other[1]]))[2] / max(far, 1e-9)


def within_grids(policy, target):
    """A target beyond all grids is seen where they end, in the same direction."""
    axes = [axis for behaviour in policy.behaviours for axis in behaviour.grid.axes if axis.name == "distance"]
    furthest = max(axis.maximum + axis.fade for axis in axes)
    distance = np.hypot(target[0], target[2])
    shrink = furthest / distance if distance > furthest else 1.0
    return np.array([target[0] * shrink, target[1], target[2] * shrink])


def crowding(one, action, mine, near, positions, crowd, opponent):
    """What an action costs for neighbours and the arena."""
    rules = crowd.crowding
    left_over = min(one.phase - one.length, one.speed)
    frames = max(float(one.policy.actions.lengths[action]) - left_over, 0.0) / one.speed
    end = ground.compose(mine, move_of(one.policy.actions, action) * [one.scale, one.scale, 1.0])
    halt, worst = one.halt_of(action, mine), 0.0
    for other in near:
        now = positions[other.number]
        left = (other.length - other.phase) / other.speed
        share = min(frames / left, 1.0) if left > 0 else 1.0
        then = now + share * (other.end() - now)
        space = 0.5 * (one.space + other.space)
        if opponent != other.number and other.opponent != one.number:
            space *= BYSTANDERS
        room = rules.radius * (one.width + other.width) + rules.gap * space
        before, after = (now - mine)[:2], (then - end)[:2]
        halted = (other.halts - halt)[:2]
        worst = max(worst, rules.end * space * (1 - float(np.hypot(*after)) / room))
        worst = max(worst, rules.end * space * (1 - nearest_approach(after, halted)[0] / (HALTED * room)))
        passing, t = nearest_approach(before, after)
        if t > 0:
            worst = max(worst, rules.path * (1 - passing / room))
    return worst + rules.outside * outside(crowd.arena, end[0], end[1])


def mark_of(position, state, avatars, aside=0.0, onwards=0.0):
    """Place of a mark: a hash of the cell that a position is in, or so many sides of a cell from it, and the state."""
    column = math.floor(position[0] / CELL + aside)
    row = math.floor(position[1] / CELL + onwards)
    size = 1 << 14
    while size < 32 * avatars:
        size *= 2
    return ((column * 73856093 ^ row * 19349663) + state) % size


def repetition(one, action, frame, marks, avatars):
    """What an action costs whose motion was shown lately by anyone around, or by the avatar itself."""
    state = twin_of(one, action)
    last = marks.get(mark_of(one.stands(), state, avatars), -math.inf)
    lately = frame - last < variety.LATELY
    own = [shown % NONE for shown in one.shown[-LATEST:]]
    return (variety.OTHERS if lately else 0.0) + variety.OWN * (state % NONE in own)


def throws_too(one, other, action, frame):
    """Whether an opponent throws the strikes of an action too, or they are left to it where both decide."""
    piece, ends = twin_of(one, action), frame + int(one.policy.actions.lengths[action] / one.speed)
    left = ((piece * 40503 + frame * 30011) >> 7) % 2 != (one.number > other.number)
    same = piece == other.thrown and abs(ends - other.thrown_until) < TOGETHER
    return same or (left and other.phase >= other.length)


def twin_of(one, action):
    """Number of the state that an action ends in, a mirror image's that of what it mirrors."""
    captured = one.policy.graph.captured_states(one.policy.database.captured_frames)
    return one.first_state + int(one.policy.actions.next[action]) % captured


@once
def space_of(policy):
    """Share of the gap between bodies that short strikes leave."""
    return min(1.0, np.median(np.hypot(*policy.database.strike_positions.astype(float).T[[0, 2]])) / FULL_REACH)


def giving_way(one, action, mine, frame):
    """How far an action leads where a hit pushes an avatar, less what is more than it still does."""
    strength, since = np.hypot(*one.hit), frame - one.hit_frame
    if since > PUSHED or strength < LIGHT:
        return 0.0
    far = min(STEP * strength**2, FURTHEST) * (1.0 - since / (PUSHED + 1))
    end = ground.compose(mine, move_of(one.policy.actions, action) * [one.scale, one.scale, 1.0])
    along = float((end - mine)[:2] @ one.hit) / strength
    return far - abs(far - along)


def strikes_while_stunned(one, action, frame):
    """How many strikes an action throws before its avatar has recovered from a hit."""
    left = min(STUNS * np.hypot(*one.hit), LONGEST) - (frame - one.hit_frame)
    offsets = one.policy.actions.strike_offsets[action : action + 2]
    times = one.policy.actions.strike_times[slice(*offsets)].astype(np.float32)
    return int(np.count_nonzero(times < left * one.speed)) if left > 0.0 else 0


def pick(values, one, crowd):
    """Place of the action that is drawn among the candidates."""
    best = max(range(len(values)), key=lambda k: (values[k], -k))
    temperature = crowd.temperatures[one.cohort]
    if temperature <= 0:
        return best
    order = sorted(range(len(values)), key=lambda k: (-values[k], k))[: crowd.most[one.cohort]]
    candidates = sorted(k for k in order if values[k] >= values[best] - crowd.margins[one.cohort])
    chances = np.exp((values[candidates] - values[best]) / temperature)
    number = float(uniform(crowd.seed, Purpose.CHOICE, one.number, one.decisions))
    place = np.searchsorted(np.cumsum(chances), number * chances.sum(), side="right")
    return candidates[min(place, len(candidates) - 1)]
