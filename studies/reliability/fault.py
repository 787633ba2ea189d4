"""A fault and what came of it: one row of the table in docs/reliability.md."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

COLUMNS = ("fault", "tried", "by the reader", "by validate", "nothing changed", "lost in silence", "for example")


class Try(NamedTuple):
    """What came of a fault at one place.

    noticed: `reader` if the step or user who reads it gets an error, `validate` if only `snakemake validate` fails,
    `unchanged` if all that is read is as before, `silent` if it is not and nobody said so. message: of the error.
    """

    noticed: str
    message: str = ""


class Fault(NamedTuple):
    """A fault: its name, and the function that applies it to a copy of a run.

    apply: from the copy, which it leaves as it was, a random generator and the number of tries to what came of each.
    """

    name: str
    apply: Callable[[Path, np.random.Generator, int], Sequence[Try]]


def row(name: str, tries: Sequence[Try], run: Path) -> dict[str, str | int]:
    """One row of the table; the run's path is RUN in its message."""
    counts = [sum(found.noticed == each for found in tries) for each in ("reader", "validate", "unchanged", "silent")]
    messages = [found.message for found in tries if found.message]
    example = (messages[0] if messages else "").splitlines()[:1]
    return dict(zip(COLUMNS, (name, len(tries), *counts, "".join(example).replace(str(run), "RUN")), strict=True))
