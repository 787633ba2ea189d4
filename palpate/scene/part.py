"""A part that scenes of a kind can go without."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple


class Part(NamedTuple):
    """A part of a kind of scene.

    why: the reason for which it is left out. keeps: given the facts of a scene, the reason for which it
    stays in this one; None to leave it out. modelled: False if leaving it out is a choice of the model, which
    changes the result, and not a saving.
    """

    why: str
    keeps: Callable[[Mapping[str, Any]], str | None] = lambda facts: None
    modelled: bool = True


def stays(why: str) -> Part:
    """A part that is always in: leaving it out would change the result, or would save nothing."""
    return Part("", lambda facts: why)


def unmodelled(why: str) -> Part:
    """A part that the model goes without by choice: putting it in would change the result."""
    return Part(why, modelled=False)
