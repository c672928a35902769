"""What a policy is bad at, by the statistics of its bundle."""

import copy

import pytest

from crowdsim.training.weaknesses import find_weaknesses

GOOD = {
    "motion": {
        "clips": 2, "seconds": 200.0, "mirrored": False, "frames": 3000, "frames_kept": 2900, "strikes": 40,
        "frames_kept_by_clip": {"a": 1500, "b": 1400},
    },
    "graph": {"branching": 7.0, "threshold": 0.25},
    "strikes": {
        "reach": {"height": [1.0, 1.5]},
        "striking_range": [0.8, 0.9],
        "used_share": 0.9,
        "by_hand": {"left": 20, "right": 20},
        "by_kind": {"straight": 20, "hook": 15, "uppercut": 5},
        "by_height": {"head": 30, "body": 10},
    },
    "sustained_speed": 1.5,
    "duel": {
        "seconds": 60.0, "thrown": 40.0, "landed": 20.0, "longest_wait": 4.0, "turned_away_share": 0.01,
        "still_share": 0.0, "distance": 0.9, "waiting_distance": 0.9, "waiting_actions": 12,
    },
    "behaviours": {
        "fight": {
            "converged": True,
            "success": {"task": "strike", "seconds": 6.0, "share": 0.99, "median_seconds": 1.0, "share_behind": 0.98},
        },
        "approach": {
            "converged": True,
            "success": {"task": "arrive", "seconds": 10.0, "share": 1.0, "median_seconds": 1.0, "share_behind": 1.0},
        },
    },
}  # fmt: skip


def changed(*changes):
    result = copy.deepcopy(GOOD)
    for path, value in changes:
        *keys, last = path.split(".")
        place = result
        for key in keys:
            place = place[key]
        place[last] = value
    return result


def weaknesses_of(*changes):
    return [weakness.what for weakness in find_weaknesses(changed(*changes))]


def test_a_good_policy_has_no_weakness():
    assert weaknesses_of() == []


@pytest.mark.parametrize(
    ("path", "value", "what"),
    [
        ("motion.seconds", 12.0, "little motion: 12 s, which soon repeats itself"),
        ("motion.frames_kept", 1200, "60% of the motion is not used, for want of transitions"),
        ("motion.frames_kept_by_clip", {"a": 1500, "b": 0},
         "1 clip is not used, for want of transitions to and from the others: b"),
        ("graph.branching", 2.1, "few transitions: 2.1 actions a state"),
        ("strikes.used_share", 0.25, "75% of the strikes are not used, for want of transitions to them"),
        ("strikes.by_hand.left", 0, "no strikes with the left hand"),
        ("strikes.by_kind.straight", 39, "nearly all strikes are of one kind, straight"),
        ("strikes.by_height.head", 1, "2% of the strikes go to the head"),
        ("strikes.reach.height", [1.2, 1.5], "strikes reach only heights of 1.2 to 1.5 m"),
        ("sustained_speed", 0.4,
         "slow: follows a target at 0.4 m/s at most, one that walks at 1.2 m/s gets away"),
        ("behaviours.fight.success.share", 0.5, "fight lands a strike within 6 s in only 50% of trials"),
        ("behaviours.approach.success.share", 0.5, "approach comes to its target within 10 s in only 50% of trials"),
        ("behaviours.fight.success.share_behind", 0.3,
         "fight lands a strike in only 30% of trials where the target is behind at first"),
        ("behaviours.fight.converged", False, "fight was not learned to its tolerance"),
        ("duel.landed", 3.0, "few strikes land in a minute of a duel: 3.0 of 40.0"),
        ("duel.turned_away_share", 0.09, "turned away from its opponent in 9% of the time of a duel"),
        ("duel.longest_wait", 24.0,
         "a duel has no strike for 24 s: the two are 0.9 m apart, where keeping the distance is worth more than "
         "striking"),
        ("duel.still_share", 0.84,
         "stands still in 84% of the time of a duel: the two are 0.9 m apart, where keeping the distance is worth more "
         "than striking"),
    ],
)  # fmt: skip
def test_each_weakness_is_found_by_its_figure(path, value, what):
    found = weaknesses_of((path, value))
    assert what in found
    # A lower share of all trials is one that hardly differs behind, and nothing else is found.
    assert len(found) == 1


def test_mirror_images_make_strikes_of_both_hands():
    assert weaknesses_of(("strikes.by_hand.left", 0), ("motion.mirrored", True)) == []


def test_motion_without_strikes_is_a_weakness_of_its_own():
    found = weaknesses_of(("motion.strikes", 0))
    assert found == ["no strikes: avatars come to their targets and do no more"]
    assert weaknesses_of(("motion.strikes", 4), ("strikes.by_height.head", 2)) == [
        "few strikes: 4, which soon repeat themselves"
    ]


@pytest.mark.parametrize(
    ("changes", "cause", "advice"),
    [
        ([("duel.waiting_distance", 1.9), ("sustained_speed", 0.1)],
         "the two are 1.9 m apart, and strikes reach 0.8 to 0.9 m; the motion has hardly any steps",
         "add clips of steps and turns in the stance of the strikes"),
        ([("duel.waiting_distance", 1.9)],
         "the two are 1.9 m apart, and strikes reach 0.8 to 0.9 m",
         "add clips of steps that end in the stance of the strikes"),
        ([("duel.waiting_actions", 2)],
         "it repeats 2 actions; every way out is worth less",
         "add clips that begin and end in that stance, or raise graph.threshold"),
    ],
)  # fmt: skip
def test_the_cause_of_standing_still_is_named(changes, cause, advice):
    found = find_weaknesses(changed(("duel.still_share", 0.9), *changes))
    weakness = next(one for one in found if one.what.startswith("stands still"))
    assert (weakness.what, weakness.advice) == (f"stands still in 90% of the time of a duel: {cause}", advice)


def test_a_policy_that_was_never_graded_has_no_weakness_of_duels():
    assert weaknesses_of(("duel", None)) == []
