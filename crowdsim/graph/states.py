"""States and actions: what control sees of a motion graph.

Frames are nodes. A frame's successors are the next frame of its clip and the targets of its transitions. Of these the
largest strongly connected component is kept, so that every frame kept can be reached from every other. A *state* is a
frame with more than one successor, an *action* the captured motion from a successor to the next state (the paper's
section 3). Because an action shows neighbouring frames of one clip, a frame that only a transition leads out of, as at
the end of a clip, is a state too, with one action.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import MotionError
from crowdsim.graph.transitions import Transitions


@dataclass(frozen=True)
class MotionGraph:
    """States and actions of a motion database: S states, A actions, F control frames, T transitions kept.

    Attributes:
        state_frames: Control frame of each state, ascending. Shape (S,), int32.
        action_offsets: Actions of state s are ``action_offsets[s]`` up to ``action_offsets[s + 1]``: the one that
            continues the capture first, where there is one, then the others by their first frame. Shape (S + 1,),
            int32.
        action_next: State in which each action ends. Shape (A,), int32.
        action_first: Control frame shown one frame after the state's frame. Shape (A,), int32. The action shows frames
            ``action_first`` to ``action_first + T - 1``, placed so that the ground transform of frame
            ``action_first - 1`` is aligned with that of the avatar in the state. Its last frame is that of the
            state ``action_next``.
        action_lengths: Frames T that each action shows, at least 1. Shape (A,), int32.
        action_costs: Cost of the transition into each action [m]; 0 where it continues the capture. Shape (A,),
            float32.
        frames_kept: Whether each frame belongs to the component kept. Shape (F,), bool.
        transition_from: Frame after which each transition happens, ascending. Shape (T,), int32.
        transition_to: Frame shown next. Shape (T,), int32.
        transition_costs: Distance of ``transition_from`` and ``transition_to - 1`` [m]. Shape (T,), float32.
        threshold: Largest cost allowed [m].
        warnings: What a user should know of, a sentence each.
    """

    state_frames: Array
    action_offsets: Array
    action_next: Array
    action_first: Array
    action_lengths: Array
    action_costs: Array
    frames_kept: Array
    transition_from: Array
    transition_to: Array
    transition_costs: Array
    threshold: float
    warnings: tuple[str, ...] = ()

    @property
    def state_count(self) -> int:
        """Number of states S."""
        return len(self.state_frames)

    @property
    def action_count(self) -> int:
        """Number of actions A, falls included."""
        return len(self.action_next)

    @property
    def choice_count(self) -> int:
        """Number of actions that belong to states; those behind them are falls."""
        return int(self.action_offsets[-1])

    @property
    def without_falls(self) -> MotionGraph:
        """The graph of the actions that belong to states."""
        count = self.choice_count
        if count == self.action_count:
            return self
        names = ("action_next", "action_first", "action_lengths", "action_costs")
        return replace(self, **{name: getattr(self, name)[:count] for name in names})

    @property
    def action_states(self) -> Array:
        """State in which each action begins that belongs to one. Shape (choice_count,), int32."""
        return np.repeat(np.arange(self.state_count, dtype=np.int32), np.diff(self.action_offsets))

    @property
    def action_has_transition(self) -> Array:
        """Whether each of these begins with a transition, not the captured next frame. Shape (choice_count,), bool."""
        return self.action_first[: self.choice_count] != self.state_frames[self.action_states] + 1

    def captured_states(self, captured: int) -> int:
        """Return the number of states before their mirror images: that of state s is s + this.

        S where the graph is not its own mirror image. Behind the captured frames lie their mirror images.
        """
        return self.state_count // 2 if len(self.action_images(captured)) else self.state_count

    def action_images(self, captured: int) -> Array:
        """Return the mirror image of each action of the captured states. Shape (choice_count / 2,), int64.

        Empty where the graph is not its own mirror image. Behind the captured frames lie their mirror images.
        """
        frames, half, count = len(self.frames_kept), self.state_count // 2, self.choice_count // 2
        first = self.action_first[: self.choice_count]
        own, others = self.state_frames[:half], self.state_frames[half:]
        if 2 * captured == frames and np.array_equal(own + captured, others):
            pairs = self.state_frames[self.action_states].astype(np.int64) * frames + first
            images = pairs[:count] + captured * frames
            images += np.where(first[:count] < captured, captured, -captured)
            order = np.argsort(pairs, kind="stable")
            if np.array_equal(np.sort(images), pairs[order][count:]):
                return order[np.searchsorted(pairs[order], images)]
        return np.zeros(0, np.int64)


def graph_of_transitions(
    transitions: Transitions, clip_starts: Array, threshold: float, clip_names: tuple[str, ...] = ()
) -> MotionGraph:
    """Build states and actions of transitions, all of which are taken.

    Args:
        transitions: The transitions; none leads to the first frame of a clip.
        clip_starts: First frame of each clip, and F. Shape (C + 1,).
        threshold: Largest cost that was allowed [m].
        clip_names: Names of the clips for messages; parts of a clip, which may be left out, have empty ones.

    Raises:
        MotionError: The graph has no cycle, or only one loop without a decision.
    """
    frames = int(clip_starts[-1])
    kept = largest_component(transitions, clip_starts)
    if not kept.any():
        raise MotionError(_no_cycle(len(transitions), clip_starts, threshold))
    inside = transitions.chosen(kept[transitions.sources] & kept[transitions.targets])
    sources, targets, costs = inside.sources, inside.targets, inside.costs
    continues = _continues(kept, clip_starts)
    successors = continues + np.bincount(sources, minlength=frames)
    if successors.max() < 2:
        raise MotionError(
            f"the motion graph is a single loop of {int(kept.sum())} frames without a decision: "
            f"{len(sources)} transitions cost {threshold:.3f} m or less; raise graph.threshold or add capture"
        )
    state_frames = np.flatnonzero(kept & ((successors > 1) | ~continues)).astype(np.int32)
    onward = state_frames[continues[state_frames]]
    starts = np.concatenate([onward, sources])
    firsts = np.concatenate([onward + np.int32(1), targets])
    prices = np.concatenate([np.zeros(len(onward), np.float32), costs])
    order = np.lexsort((firsts, np.arange(len(starts)) >= len(onward), starts))
    starts, firsts, prices = starts[order], firsts[order], prices[order]
    # Every frame that is no state leads on to the next of its clip, so the next state is the first at or after it.
    nexts = np.searchsorted(state_frames, firsts).astype(np.int32)
    offsets = np.searchsorted(starts, state_frames).astype(np.int32)
    return MotionGraph(
        state_frames=state_frames,
        action_offsets=np.append(offsets, np.int32(len(starts))),
        action_next=nexts,
        action_first=firsts,
        action_lengths=state_frames[nexts] - firsts + np.int32(1),
        action_costs=prices,
        frames_kept=kept,
        transition_from=sources,
        transition_to=targets,
        transition_costs=costs,
        threshold=float(threshold),
        warnings=_dropped_clips(kept, clip_starts, clip_names),
    )


def largest_component(transitions: Transitions, clip_starts: Array) -> Array:
    """Return which frames lie in the largest strongly connected component; none where there is no cycle. Shape (F,).

    Among components of one size the one that holds the earliest frame is taken.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    frames = int(clip_starts[-1])
    onward = np.flatnonzero(_continues(np.ones(frames, bool), clip_starts))
    rows = np.concatenate([onward, transitions.sources])
    columns = np.concatenate([onward + 1, transitions.targets])
    edges = csr_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(frames, frames))
    _, labels = connected_components(edges, directed=True, connection="strong")
    sizes = np.bincount(labels, minlength=1)
    if frames == 0 or sizes.max() < 2:
        return np.zeros(frames, bool)
    earliest = int(np.flatnonzero(sizes[labels] == sizes.max())[0])
    return labels == labels[earliest]


def _continues(kept: Array, clip_starts: Array) -> Array:
    """Return whether each kept frame's captured next frame exists and is kept. Shape (F,), bool."""
    result = np.zeros(len(kept), bool)
    result[:-1] = kept[:-1] & kept[1:]
    result[np.asarray(clip_starts)[1:] - 1] = False
    return result


def _dropped_clips(kept: Array, clip_starts: Array, clip_names: tuple[str, ...]) -> tuple[str, ...]:
    """Return a sentence for each clip of which no frame is kept."""
    return tuple(
        f"clip {name!r} drops out of the motion graph: none of its {stop - start} frames can be reached and left again"
        for name, start, stop in zip(clip_names, clip_starts[:-1], clip_starts[1:], strict=False)
        if name and not kept[start:stop].any()
    )


def _no_cycle(transitions: int, clip_starts: Array, threshold: float) -> str:
    """Return why there is no cycle, in numbers."""
    return (
        f"the motion graph has no cycle: {int(clip_starts[-1])} frames in {len(clip_starts) - 1} clips, and "
        f"{transitions} transitions that cost {threshold:.3f} m or less; "
        "raise graph.threshold, or add capture that comes back to poses it has shown"
    )
