"""What is done once before workers begin: policies trained and frozen, kernels compiled, scenarios frozen."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from crowdsim.batch.resolving import Resolved
from crowdsim.core.types import FileName, Progress
from crowdsim.errors import OutputError
from crowdsim.files import copy_plain, exists_plain, is_folder, make_folder, move_plain, remove_tree, walk

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

_STALLED = 60.0
"""When nothing has been compiled for so long, kernels are left to the workers [s]."""


def train_policies(
    runs: Iterable[Resolved],
    mocap: FileName | None,
    threads: int,
    progress: Progress | None = None,
    notify: Callable[[str], None] | None = None,
) -> dict[str, Policy]:
    """Return the policies that runs use, by name; trained when missing or stale.

    Raises:
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
    """
    from crowdsim.preparation.prepare import load_policies, policy_names, training_notice, untrained_policies

    found: dict[str, Policy] = {}
    for one in runs:
        if set(policy_names(one.scenario)) <= found.keys():
            continue
        if notify is not None:
            for name in untrained_policies(one.scenario, mocap):
                notify(training_notice(name, threads))
        found.update({policy.name: policy for policy in load_policies(one.scenario, mocap, threads, progress)})
    return found


def freeze_policies(folder: Path, names: Collection[str]) -> None:
    """Keep policies in a folder, from which all workers map them into memory; those that are there stay.

    Raises:
        OutputError: They cannot be written.
    """
    from crowdsim.training.train import find_bundle

    make_folder(folder)
    for name in names:
        partial, bundle = f".{name}.part", find_bundle(name)
        if exists_plain(folder, f"{name}/policy.json"):
            continue
        try:
            if is_folder(folder, partial):
                remove_tree(folder, partial)
            for file in walk(bundle):
                # It is never changed once it is written.
                copy_plain(bundle / file, folder, f"{partial}/{file}", link=True)
            move_plain(folder, partial, folder, name)
        except OSError as error:
            raise OutputError(f"{folder / name}: cannot be written: {error.strerror or error}") from None


def used_kernels(runs: Iterable[Resolved]) -> list[str]:
    """Return what runs need kernels for; a picture is made of each."""
    from crowdsim.preparation.prepare import kernel_uses

    found = {"pictures": None}
    for one in runs:
        whole = one.scenario.model_copy(update={"outputs": one.outputs})
        found.update(dict.fromkeys(kernel_uses(whole)))
    return list(found)


def compile_kernels(uses: Collection[str], processes: int, notify: Callable[[str], None] | None = None) -> None:
    """Compile the kernels that some uses need and that are not compiled yet; where they are, nothing is loaded.

    Args:
        uses: What kernels will be needed for.
        processes: Processes that compile.
        notify: Called with what is missing, and about how long it takes.
    """
    from crowdsim.jit.ahead import compile_ahead, compile_listed
    from crowdsim.jit.signatures import listed

    with compile_ahead(uses, processes) as missing:
        if not missing:
            return
        if notify is not None:
            notify(missing)
        left, since = missing, time.monotonic()
        while left and time.monotonic() - since < _STALLED:
            for one in listed(uses):
                compile_listed(one)
            # What the other processes are compiling is left to them, and looked at again.
            time.sleep(0.1)
            before = left
            with compile_ahead(uses, 0) as left:
                since = since if left == before else time.monotonic()
