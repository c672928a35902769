"""Training against QuantEcon and against the paper, on a synthetic model of the paper's size.

437 states and 27,072 actions of 2 to 12 control frames; punch on 10 x 10 x 4 cells and approach on 5 x 13; discount
0.97 a frame. QuantEcon gets the same punch model as a sparse matrix, corners of weight 0 left out, float64; ours keeps
values in float32. Both do one Bellman sweep over 10.8 million pairs; each number is the least of several.

`return_ratio`: return over random episodes of the policies that Q-learning found, over that of value iteration with the
same backup; the lower one of approach (target still) and punch (target moving). The paper took 2 h and 4 h 15 min.

With ``--quick`` the model is a tenth as large and Q-learning ends early, for a look at whether everything runs: its
figures mean nothing.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from typing import Any

import numpy as np
import scipy.sparse
from _quick import command_line

from crowdsim.core.workers import CORES, limited, share
from crowdsim.policy.actions import Actions
from crowdsim.policy.environment import Axis, Grid, build_grid
from crowdsim.policy.policy import Behaviour
from crowdsim.policy.rewards import ProximityTerm, StrikeTerm, TargetBody, Term
from crowdsim.training.evaluation import EpisodeSettings, run_episodes
from crowdsim.training.kernels.improvement import improve
from crowdsim.training.model import Model, Movement, build_model, build_movement
from crowdsim.training.q_learning import q_learning
from crowdsim.training.solution import Solution, sweep_model
from crowdsim.training.value_iteration import value_iteration

DISCOUNT = 0.97
RATE = 15.0
PAPER = {"approach": 2 * 3600.0, "punch": 4.25 * 3600.0}


def synthetic_actions(states: int = 437, count: int = 27072, seed: int = 1) -> Actions:
    """Return random actions: 2 to 12 frames at up to walking pace, three in ten with a strike."""
    draw = np.random.default_rng(seed)
    n = np.full(states, count // states)
    n[: count - n.sum()] += 1
    lengths = draw.integers(2, 13, count).astype(np.int32)
    path_offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    frames = np.arange(path_offsets[-1]) - np.repeat(path_offsets[:-1], lengths) + 1
    steps = draw.normal(0.0, [0.04, 0.05, 0.06], (count, 3))
    strikes = draw.random(count) < 0.3
    k = int(strikes.sum())
    bearing, distance = draw.uniform(-1.114, 1.317, k), draw.uniform(0.3, 1.3, k)
    positions = np.stack([distance * np.sin(bearing), draw.uniform(1.2, 1.6, k), distance * np.cos(bearing)], -1)
    return Actions(
        offsets=np.concatenate([[0], np.cumsum(n)]).astype(np.int32),
        next=draw.integers(0, states, count).astype(np.int32),
        lengths=lengths,
        shifts=np.zeros((count, 3), np.float32),
        costs=np.where(np.arange(count) % 62 == 0, 0.0, draw.random(count)).astype(np.float32),
        path_offsets=path_offsets,
        paths=(np.repeat(steps, lengths, axis=0) * frames[:, None]).astype(np.float32),
        strike_offsets=np.concatenate([[0], np.cumsum(strikes)]).astype(np.int32),
        strike_times=(draw.uniform(0.1, 1.0, k) * lengths[strikes]).astype(np.float32),
        strike_positions=positions.astype(np.float32),
        strike_origins=positions[:, [0, 2]].astype(np.float32),
        strike_speeds=draw.uniform(0.5, 1.5, k).astype(np.float32),
        strike_ids=np.arange(k, dtype=np.int32),
    )


def paper_grids() -> dict[str, Grid]:
    """Return the paper's grids."""
    circle = Axis("bearing", -np.pi, np.pi, 13, wraps=True)
    punch = [Axis("distance", 0.297, 1.293, 10), Axis("bearing", -1.114, 1.317, 10), Axis("height", 1.266, 1.624, 4)]
    return {"approach": build_grid([Axis("distance", 0.0, 4.0, 5), circle]), "punch": build_grid(punch)}


def paper_terms() -> dict[str, tuple[Term, ...]]:
    """Return the rewards."""
    return {
        "approach": (ProximityTerm(kind="proximity", distance=0.5, sigma=0.5),),
        "punch": (StrikeTerm(kind="strike", tolerance=0.1),),
    }


def quantecon_problem(model: Model) -> Any:
    """Return the model as QuantEcon's state-action-pair problem, the discount inside its transition matrix."""
    from quantecon.markov import DiscreteDP

    cells, layers = model.grid.cells, model.grid.layers
    corners, corner_weights = (part[0] for part in model.corners(0, model.action_count))
    corner_weights = corner_weights.astype(float) * model.discounts.astype(float)[:, None, None]
    entries = model.next.astype(np.int64)[:, None, None] * cells + corners
    pairs = model.action_count * cells
    data, columns = np.empty((pairs, 4)), np.empty((pairs, 4), np.int32)
    rewards, states, actions = np.empty(pairs), np.empty(pairs, np.int64), np.empty(pairs, np.int64)
    for s in range(model.state_count):
        first, end = int(model.offsets[s]), int(model.offsets[s + 1])
        n, place = end - first, slice(first * cells, end * cells)
        layered = entries[first:end, :, None, :] + np.arange(layers)[:, None]
        columns[place] = layered.reshape(n, cells, 4).transpose(1, 0, 2).reshape(-1, 4)
        weights = np.repeat(corner_weights[first:end, :, None, :], layers, axis=2)
        data[place] = weights.reshape(n, cells, 4).transpose(1, 0, 2).reshape(-1, 4)
        rewards[place] = model.rewards(first, end).T.ravel()
        states[place] = np.repeat(s * cells + np.arange(cells), n)
        actions[place] = np.tile(np.arange(n), cells)
    matrix = scipy.sparse.csr_matrix(
        (data.ravel(), columns.ravel(), np.arange(pairs + 1) * 4), shape=(pairs, model.state_count * cells)
    )
    matrix.eliminate_zeros()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return DiscreteDP(rewards, matrix, 1.0, states, actions)


def time_sweeps(model: Model, repeats: int) -> dict[str, float]:
    """Return the least seconds of a sweep by QuantEcon and by ours on one and two threads."""
    problem = quantecon_problem(model)
    packed, layers = sweep_model(model), model.grid.layers
    size = model.state_count * model.grid.cells
    values = np.random.default_rng(2).random(size)
    theirs, ours = np.empty(size), np.empty((model.state_count, model.grid.cells), np.float32)
    changes, narrow = np.empty(model.state_count, np.float32), values.astype(np.float32)

    def sweep(threads: int) -> float:
        started = time.perf_counter()
        share(model.state_count, improve, packed, layers, narrow, 0, 1, ours, changes, threads=threads)
        return time.perf_counter() - started

    def reference() -> float:
        started = time.perf_counter()
        problem.bellman_operator(values, theirs)
        return time.perf_counter() - started

    threads = [count for count in (1, 2) if count <= CORES]
    for run in [*[lambda n=n: sweep(n) for n in threads], reference]:
        run()
    # Taken in turn, so that what else the machine does hits all alike.
    taken: dict[str, list[float]] = {"quantecon": [], **{f"ours_{n}t": [] for n in threads}}
    for _ in range(repeats):
        taken["quantecon"].append(reference())
        for n in threads:
            taken[f"ours_{n}t"].append(sweep(n))
    difference = float(np.abs(ours.ravel() - theirs).max())
    if difference > 1e-4:
        raise SystemExit(f"the sweeps differ by {difference}")
    return {name: min(seconds) for name, seconds in taken.items()}


def mean_return(actions: Actions, grid: Grid, terms: tuple[Term, ...], solution: Solution, speed: float) -> float:
    """Return the mean return of 2,000 episodes by a Q-table."""
    assert solution.q is not None
    behaviour = Behaviour("learned", grid, "q", solution.q, 1.0, terms, DISCOUNT)
    draw = np.random.default_rng(3)
    states = draw.integers(0, actions.state_count, 2000)
    targets = grid.targets()[draw.integers(0, grid.cells, 2000)]
    settings = EpisodeSettings(seconds=10.0, target_speed=speed, seed=4)
    episodes = run_episodes(actions, behaviour, TargetBody(), RATE, states, targets, settings, threads=2)
    return float(episodes.returns.mean())


def measure(repeats: int = 7, movement_speed: float = 0.5, quick: bool = False) -> dict[str, Any]:
    """Return everything that the table shows."""
    actions = synthetic_actions(44, 2700) if quick else synthetic_actions()
    learning: dict[str, Any] = {"max_sweeps": 10} if quick else {}
    grids, terms, body = paper_grids(), paper_terms(), TargetBody()
    models, build_seconds = {}, 0.0
    for name, grid in grids.items():
        build_model(actions, grid, terms[name], body, DISCOUNT)
        started = time.perf_counter()
        models[name] = build_model(actions, grid, terms[name], body, DISCOUNT)
        build_seconds += time.perf_counter() - started
    sweeps = time_sweeps(models["punch"], repeats)

    for model in models.values():
        value_iteration(model)
    solved = {name: value_iteration(model) for name, model in models.items()}
    learned, ratios = {}, {}
    for name, grid in grids.items():
        moving = movement_speed if name == "punch" else 0.0
        movement = build_movement(moving, still=0.0, control_rate=RATE) if moving else None
        model = build_model(
            actions, grid, terms[name], body, DISCOUNT, movement or Movement(np.ones(1), np.zeros((1, 2)))
        )
        q_learning(model, max_sweeps=1)
        learned[name] = q_learning(model, **learning)
        exact = value_iteration(model, "max_of_interpolated", tolerance=1e-3)
        achieved = [mean_return(actions, grid, terms[name], one, moving) for one in (learned[name], exact)]
        ratios[name] = {
            "return_ratio": achieved[0] / achieved[1],
            "value_ratio": float(learned[name].values.mean(dtype=float) / exact.values.mean(dtype=float)),
        }
    return {
        "pairs": models["punch"].action_count * models["punch"].grid.cells,
        "sweeps": sweeps,
        "build_seconds": build_seconds,
        "value_iteration": {name: _told(solution) for name, solution in solved.items()},
        "q_learning": {name: {**_told(solution), **ratios[name]} for name, solution in learned.items()},
    }


def _told(solution: Solution) -> dict[str, Any]:
    return {
        "seconds": solution.seconds,
        "sweeps": solution.sweeps,
        "residual": solution.residuals[-1],
        "updates_per_second": solution.updates / solution.seconds,
    }


def summary(outcome: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers under the names that checks rely on."""
    sweeps, vi, ql = outcome["sweeps"], outcome["value_iteration"], outcome["q_learning"]
    return {
        "value_iteration": {
            "ratio_to_quantecon_1t": sweeps["quantecon"] / sweeps["ours_1t"],
            "ratio_to_quantecon_2t": sweeps["quantecon"] / sweeps.get("ours_2t", sweeps["ours_1t"]),
            "seconds_both_tables": sum(one["seconds"] for one in vi.values()),
        },
        "q_learning": {
            "seconds_both_tables": sum(one["seconds"] for one in ql.values()),
            "return_ratio": min(one["return_ratio"] for one in ql.values()),
        },
    }


def main() -> None:
    parser = command_line("Training against QuantEcon and the paper.", "a small model, to see that all runs")
    parser.add_argument("--repeats", type=int, default=7, help="sweeps timed of each kind")
    options = parser.parse_args()
    with limited(2):
        outcome = measure(2 if options.quick else options.repeats, quick=options.quick)
    if options.json:
        json.dump(summary(outcome), sys.stdout, indent=2)
        print()
        return
    short = summary(outcome)
    print(f"One Bellman sweep, punch, {outcome['pairs'] / 1e6:.1f} M pairs [ms]")
    for name, seconds in outcome["sweeps"].items():
        ratio = outcome["sweeps"]["quantecon"] / seconds
        print(f"  {name:<12}{seconds * 1e3:9.1f}{ratio:8.1f} x")
    print(f"Building both models: {outcome['build_seconds']:.2f} s")
    print(f"{'':<28}{'seconds':>9}{'sweeps':>8}{'residual':>10}{'M updates/s':>13}{'paper':>10}")
    for solver in ("value_iteration", "q_learning"):
        for name, one in outcome[solver].items():
            print(
                f"{solver + ' ' + name:<28}{one['seconds']:9.2f}{one['sweeps']:8d}{one['residual']:10.4f}"
                f"{one['updates_per_second'] / 1e6:13.0f}{PAPER[name]:9.0f}s"
            )
    for name, one in outcome["q_learning"].items():
        print(f"q_learning {name}: {one['return_ratio']:.3f} of the return, {one['value_ratio']:.3f} of the mean value")
    print(f"Both tables: {short['value_iteration']['seconds_both_tables']:.2f} s by value iteration, ", end="")
    print(f"{short['q_learning']['seconds_both_tables']:.1f} s by Q-learning")


if __name__ == "__main__":
    main()
