"""Statistics of a run are the same however its control frames come, and those of a plain count."""

from types import SimpleNamespace as Named

import numpy as np
import pytest

from crowdsim.crowd.statistics import StatisticsCounter, overlapping

COUNTS, N = (50, 30), 12


def policies(rng: np.random.Generator) -> list:
    return [
        Named(database=Named(control_rate=15.0), actions=Named(action_count=n, costs=rng.random(n) - 0.5))
        for n in COUNTS
    ]


def frames(rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    return {
        "action": rng.integers(-1, 5, (count, N)).astype(np.int32),
        "action_frame": rng.random((count, N)).astype(np.float32),
        "opponent": rng.integers(-2, 3, (count, N)).astype(np.int32),
        "x": rng.random((count, N)) * 6,
        "z": rng.random((count, N)) * 6,
    }


def naive(all_policies: list, policy: np.ndarray, rows: dict[str, np.ndarray], every: int) -> dict[str, int]:
    """Count transitions, changes of opponents and overlaps, avatar by avatar."""
    found = {"present": 0, "transitions": 0, "changes": 0, "looked": 0, "overlapping": 0}
    action, done, opponent = rows["action"], rows["action_frame"], rows["opponent"]
    for frame in range(len(action)):
        here = action[frame] >= 0
        found["present"] += int(here.sum())
        if frame % every == 0:
            found["looked"] += int(here.sum())
            found["overlapping"] += int(overlapping(rows["x"][frame][here], rows["z"][frame][here]).sum())
        for k in range(N) if frame else ():
            if action[frame, k] < 0 or action[frame - 1, k] < 0:
                continue
            begins = action[frame, k] != action[frame - 1, k] or done[frame, k] <= done[frame - 1, k]
            found["transitions"] += bool(begins and all_policies[policy[k]].actions.costs[action[frame, k]] > 0)
            pair = opponent[frame - 1, k], opponent[frame, k]
            found["changes"] += -1 not in pair and pair[0] != pair[1]
    return found


@pytest.mark.parametrize("planned", [40, 5_000_000])
@pytest.mark.parametrize("cuts", [(), (1,), (7, 7, 30)])
def test_statistics_match_naive_whatever_the_chunks(planned: int, cuts: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    some, policy, rows = policies(rng), rng.integers(0, 2, N), frames(rng, 40)
    counter = StatisticsCounter(some, policy, np.ones(N), planned)
    for low, high in zip((0, *cuts), (*cuts, 40), strict=True):
        counter.add_frames({name: values[low:high] for name, values in rows.items()})
    result, expected = counter.finish(), naive(some, policy, rows, counter._every)
    assert counter._every == (1 if planned == 40 else 30)
    assert result.opponent_changes == expected["changes"] > 0
    assert result.overlap_share == expected["overlapping"] / expected["looked"] > 0
    seconds = expected["present"] / 15.0
    assert result.transitions_per_second == pytest.approx(expected["transitions"] / seconds)
    assert expected["transitions"] > 0
