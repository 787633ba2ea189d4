"""What a scene leaves out: that the result is the same, and what it saves."""

import logging
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import pandas as pd

from palpate.scene import SCENES
from studies.timing import ROUNDS, interleaved, told_apart

log = logging.getLogger(__name__)

COLUMNS = (
    "scene", "part", "when", "left_out", "object", "seconds_with", "seconds_without", "seconds_saved",
    "bytes_with", "bytes_without", "bytes_saved", "difference", "unit", "bound", "verdict", "noisy",
)  # fmt: skip
SAME, DIFFERS = "same", "differs"


class Leaving(NamedTuple):
    """One part of one scene, with it and without it.

    Attributes:
        scene: a kind of scene of `palpate.scene`, part: one of its parts.
        when: in which scenes it is left out, in words.
        object: the object of this scene.
        with_it, without: make the result with the part and without it, everything else the same.
        difference: the largest difference between the two results, in `unit`.
        bound: what it may be at most; 0 for bit-equal.
        size: bytes of a result on disk or in memory, where leaving out saves any.
        left_out: whether the plan leaves it out; what changes the result stays in, or is a choice of the
            model (`Plan.unmodelled`).
    """

    scene: str
    part: str
    when: str
    object: str
    with_it: Callable[[], Any]
    without: Callable[[], Any]
    difference: Callable[[Any, Any], float]
    unit: str
    bound: float = 0.0
    size: Callable[[Any], float] | None = None
    left_out: bool = True


def compare(leaving: Leaving, rounds: int = ROUNDS) -> dict[str, Any]:
    """A row of `reports/left_out.csv`: times interleaved in one run, `COLUMNS`.

    `verdict` is `same` if the difference is within the bound, else `differs`; a part that differs must not be
    left out. `noisy`: the rounds don't tell the two times apart.
    """
    everything, less = leaving.with_it(), leaving.without()
    difference = float(leaving.difference(everything, less))
    size = (leaving.size(everything), leaving.size(less)) if leaving.size else (float("nan"),) * 2
    del everything, less
    times = interleaved({"with": leaving.with_it, "without": leaving.without}, rounds, warm=True)
    row = {
        "scene": leaving.scene,
        "part": leaving.part,
        "when": leaving.when,
        "left_out": leaving.left_out,
        "object": leaving.object,
        "seconds_with": times["with"].seconds,
        "seconds_without": times["without"].seconds,
        "seconds_saved": times["with"].seconds - times["without"].seconds,
        "bytes_with": size[0],
        "bytes_without": size[1],
        "bytes_saved": size[0] - size[1],
        "difference": difference,
        "unit": leaving.unit,
        "bound": leaving.bound,
        "verdict": SAME if difference <= leaving.bound else DIFFERS,
        "noisy": not told_apart(times["with"], times["without"]),
    }
    log.info("%s without %s: %s", leaving.scene, leaving.part, row)
    if leaving.left_out and row["verdict"] == DIFFERS:
        log.warning(
            "%s, %s: leaving out %s changes the result by %g %s, more than %g",
            leaving.scene, leaving.object, leaving.part, difference, leaving.unit, leaving.bound,
        )  # fmt: skip
    return row


def in_words(scene: str, part: str, same: bool, left_out: bool) -> str:
    """Whether the result is the same without a part, and what becomes of one that is not left out."""
    said = SAME if same else DIFFERS
    if left_out:
        return said
    known = SCENES.get(scene, {}).get(part)
    return f"{said}, {'stays in' if known is None or known.modelled else 'not modelled'}"


def report(leavings: Iterable[Leaving], rounds: int = ROUNDS) -> pd.DataFrame:
    """The rows of a part of `reports/left_out.csv`."""
    return pd.DataFrame([compare(each, rounds) for each in leavings], columns=list(COLUMNS))
