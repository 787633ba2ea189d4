"""The files of evaluations: their columns, and reading them back."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.rebuild_command import rebuild_advice
from palpate.seal import DamagedFile
from palpate.text_files import read_text

if TYPE_CHECKING:
    from pandas import DataFrame

# A row a sample: one object with one window of its grasps, or one image of it.
_SAMPLE = ("experiment", "seed", "object", "class", "split", "window")
SCORES = ("chamfer", "f1_tau", "f1_2tau")
QUALITY = ("bend", "folded", "gap", "across")  # palpate.learning.surface_quality
COLUMNS = (*_SAMPLE, *SCORES, *QUALITY, "seconds", "steps")
# A row a sample, successful touch and ring.
RING_COLUMNS = (*_SAMPLE, "grasp", "sensor", "ring", "points", "distance", "steps")
# A row an object, strategy and number of grasps that it chose among those stored.
SELECTION_COLUMNS = (*_SAMPLE[:-1], "strategy", "grasps", "stored", "chamfer", "steps")
# A row a successful touch.
TOUCH_COLUMNS = ("object", "class", "split", "grasp", "sensor", "cloud", "chart", "steps")


class EvaluationError(ValueError):
    """An evaluation is missing or not what it must be; the message names the file or the experiment."""


def read_table(path: Path, columns: Sequence[str]) -> DataFrame:
    """The columns of one file; objects and classes stay text. Raises EvaluationError if it is damaged or lacks one."""
    import pandas as pd

    try:
        frame = pd.read_csv(io.StringIO(read_text(path)), dtype={"object": str, "class": str})
    except DamagedFile as error:
        raise EvaluationError(str(error)) from None
    except ValueError as error:  # pandas' ParserError
        raise EvaluationError(f"{path} is not a valid CSV file ({error}); {rebuild_advice(path)}") from None
    if missing := [name for name in columns if name not in frame.columns]:
        raise EvaluationError(f"{path} has no columns {missing}; {rebuild_advice(path)}")
    return frame[list(columns)]


def read(paths: Iterable[Path | str], columns: Sequence[str] = COLUMNS) -> DataFrame:
    """The rows of evaluation files, together. Raises EvaluationError naming the first that is missing or damaged."""
    import pandas as pd

    frames = [read_table(Path(path), columns) for path in paths]
    if not frames:
        raise EvaluationError("no evaluations were given")
    return pd.concat(frames, ignore_index=True)
