"""Exceptions; their messages hold what is wrong, where, what was expected, and the choices."""

from __future__ import annotations

import difflib
import errno
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import islice

_MOST_CHOICES = 200
_LONGEST_WORD = 100
_DISK_TROUBLE = {errno.ENOSPC, errno.EIO, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}


class CrowdsimError(Exception):
    """The base of every error that crowdsim raises on purpose.

    ``exit_code`` is what the command line returns for it: 2 for invalid input, 1 for a run that failed.
    """

    exit_code = 2


class BvhError(CrowdsimError):
    """A file is no BVH, or cannot be used for the purpose."""


class MotionError(CrowdsimError):
    """Clips cannot be used together, or for training."""


class RecipeError(CrowdsimError):
    """A training recipe is invalid."""


class ScenarioError(CrowdsimError):
    """A scenario is invalid."""


class BatchError(CrowdsimError):
    """A batch of runs is invalid, or cannot be begun."""


class PolicyError(CrowdsimError):
    """A trained bundle is missing, damaged, foreign or of another version."""


class VersionError(PolicyError):
    """A trained bundle is of another format version."""


class TakeError(CrowdsimError):
    """A recorded run is missing, damaged or does not hold what was requested."""


class OutputError(CrowdsimError):
    """An output cannot be written to its path.

    Where the disk is full or fails, or the system limits the size of files, ``exit_code`` is 1: the input was valid.
    """

    def __init__(self, message: str) -> None:
        super().__init__(message)
        reason = sys.exc_info()[1]
        if isinstance(reason, OSError) and reason.errno in _DISK_TROUBLE:
            self.exit_code = 1


class RunError(CrowdsimError):
    """A run failed although its input was valid."""

    exit_code = 1


@contextmanager
def under_way() -> Iterator[None]:
    """Raise as ``RunError`` what cannot be written: its place was fit when the work began, so the input was valid."""
    try:
        yield
    except OutputError as error:
        raise RunError(str(error)) from error


def nearest(word: str, choices: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` with the choice most like ``word``, or an empty string when none is like it.

    A choice that differs by a single letter takes precedence. Only the first ``_MOST_CHOICES`` are looked at, and
    nothing is like a very long word.
    """
    if len(str(word)) > _LONGEST_WORD:
        return ""
    words = [str(choice) for choice in islice(choices, _MOST_CHOICES)]
    match = [choice for choice in words if _one_letter_apart(str(word), choice)]
    match = match or difflib.get_close_matches(str(word), words, n=1, cutoff=0.6)
    return f" (did you mean '{match[0]}'?)" if match else ""


def is_near(word: str, choice: str) -> bool:
    """Whether ``word`` may be meant to be ``choice``."""
    return bool(nearest(word, [choice]))


def _one_letter_apart(word: str, other: str) -> bool:
    """Whether a letter that is missing, added, changed or swapped with the next one is all that differs."""
    if len(word) > len(other):
        word, other = other, word
    if len(other) < 2 or len(other) - len(word) > 1:
        return False
    same = next((i for i, (a, b) in enumerate(zip(word, other, strict=False)) if a != b), len(word))
    if len(word) < len(other):
        return word[same:] == other[same + 1 :]
    swapped = word[same : same + 2] == other[same : same + 2][::-1] and word[same + 2 :] == other[same + 2 :]
    return swapped or word[same + 1 :] == other[same + 1 :]
