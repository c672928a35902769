"""Every reward term there is, and their records.

To add one, write its file beside this one and put its class into ``TERMS``: recipes, training, control and judging
know it then.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Union

import numpy as np
from pydantic import Field

from crowdsim.core.types import Array
from crowdsim.errors import RecipeError
from crowdsim.policy.dispatch_kernels import for_kinds
from crowdsim.policy.terms.hit import HitTerm
from crowdsim.policy.terms.proximity import ProximityTerm
from crowdsim.policy.terms.strike import StrikeTerm
from crowdsim.policy.terms.term import TargetBody, Term
from crowdsim.policy.terms.transition import TransitionTerm

TERMS: tuple[type[Term], ...] = (StrikeTerm, ProximityTerm, TransitionTerm, HitTerm)
"""Every reward term. Its place is its kind in a record."""

STRIKE = TERMS.index(StrikeTerm)
ONCE = -1
"""Kind in a record of all terms that are worth the same wherever the target is: compiled code passes them by."""

TERM = np.dtype(
    [
        ("kind", np.int64),
        ("weight", np.float64),
        *((name, np.float64) for name in dict.fromkeys(name for term in TERMS for name in term.numbers)),
        ("column", np.int64),
    ]
)
"""Record of a term: its kind, its weight, and numbers, each of the kinds that have it, else 0 (``Term.pack``).

``column`` is of control alone, see ``crowd.model_tables.strike_rows``."""

if TYPE_CHECKING:
    AnyTerm = Term
else:
    AnyTerm = Annotated[Union[TERMS], Field(discriminator="kind")]  # noqa: UP007


def pack_terms(terms: Sequence[Term], body: TargetBody) -> Array:
    """Return the records of terms, for a target of some sizes. Shape (n,), ``TERM``.

    Raises:
        RecipeError: A term is none of ``TERMS``.
    """
    records = np.zeros(len(terms), TERM)
    for record, term in zip(records, terms, strict=True):
        if type(term) not in TERMS:
            raise RecipeError(f"{term_name(term)!r} is no reward term, expected one of {', '.join(names())}")
        counts_somewhere = isinstance(term, StrikeTerm) or term.at_frames is not None
        record["kind"] = TERMS.index(type(term)) if counts_somewhere else ONCE
        record["weight"] = term.sign * term.weight
        for name, number in zip(term.numbers, term.pack(body), strict=True):
            record[name] = number
    return records


def once_of(terms: Sequence[Term], actions: Any) -> Array:
    """Return what each action earns by some terms wherever the target is. Shape (A,), float64."""
    return np.asarray(sum((term.of_actions(actions) for term in terms), start=np.zeros(actions.action_count)))


def term_name(term: Term) -> str:
    """Return what a recipe calls a term."""
    return str(getattr(term, "kind", type(term).__name__))


def names() -> list[str]:
    """Return what a recipe calls each of ``TERMS``."""
    return [str(term.model_fields["kind"].annotation.__args__[0]) for term in TERMS]  # type: ignore[union-attr]


def for_frame_terms(build: Callable[[str, Any, Any], Any]) -> Any:
    """Return a kernel that does for a term of any kind that counts at frames what others do for terms of one kind.

    It takes the kind, and then what the others take. ``build`` returns these for the name of a kind and its
    ``at_frames``.
    """
    cases = [
        (kind, build(name, *term.at_frames))
        for kind, (name, term) in enumerate(zip(names(), TERMS, strict=True))
        if term.at_frames is not None
    ]
    return for_kinds((kind, own.__name__, own) for kind, own in cases)
