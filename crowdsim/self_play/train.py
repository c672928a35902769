"""Training whole recipes, with fights between avatars: ``defend``, and the duels that a policy is graded by."""

from __future__ import annotations

from pathlib import Path

from crowdsim.core.types import FileName, Progress
from crowdsim.policy.policy import Policy
from crowdsim.training import train

__all__ = ["ready_policy", "train_recipe"]


def train_recipe(
    name: FileName,
    mocap: FileName | None = None,
    threads: int = 1,
    force: bool = False,
    progress: Progress | None = None,
) -> tuple[Path, bool]:
    """Train a recipe into its bundle, unless that is up to date; return its folder, and whether it was trained.

    Arguments and errors are those of ``training.train.train_recipe``.
    """
    from crowdsim.self_play.grading import grade_policy
    from crowdsim.self_play.learning import learn_defence

    return train.train_recipe(name, mocap, threads, force, progress, learn_defence, grade_policy)


def ready_policy(
    name: FileName, mocap: FileName | None = None, threads: int = 1, progress: Progress | None = None
) -> Policy:
    """Return the trained policy of a recipe or a bundle by path or name; trained first when it is missing or stale.

    Arguments and errors are those of ``training.train.ready_policy``.
    """
    from crowdsim.self_play.grading import grade_policy
    from crowdsim.self_play.learning import learn_defence

    return train.ready_policy(name, mocap, threads, progress, learn_defence, grade_policy)
