"""Parquet and a folder of images a split, as `datasets.load_dataset(<folder>)` of Hugging Face reads them.

<folder>/<split>/metadata.parquet                    a row a grasp; columns `<array>_file_name` name images
        /<split>/<object>/<grasp>/<array>.png        what every export has: palpate.interchange.folder
"""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from palpate.dataset import GraspDataset
from palpate.interchange.items import pictures, png, with_progress

ROWS = 64  # grasps that are held in memory before they are written


def write_parquet(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split as Parquet with images.

    Images are PNG files: the column `<array>_file_name` has the path of one, `<array>_file_names` a list of paths.
    Other arrays are nested lists in the contract's types. Raises ImportError if pyarrow is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ImportError(f"Parquet needs pyarrow: pip install 'pyarrow<26'; WebDataset does not ({error})") from error
    for split, grasps in splits.items():
        (folder / split).mkdir()
        writer, written, rows, path = None, None, [], folder / split / "metadata.parquet"
        with ExitStack() as stack:
            background = ThreadPoolExecutor(1)  # encodes and compresses while the next rows are read
            for number, item in enumerate(with_progress(grasps, split), start=1):
                rows.append(_row(item, grasps.images, folder / split))
                if len(rows) == ROWS or number == len(grasps):
                    table = pyarrow.table({name: _column(pyarrow, [row[name] for row in rows]) for name in rows[0]})
                    if writer is None:
                        # Numbers hardly repeat: dictionaries of them take longer, and more bytes.
                        how = {"compression": "zstd", "use_dictionary": False}
                        writer = stack.enter_context(parquet.ParquetWriter(path, table.schema, **how))
                        stack.enter_context(background)  # ends before the writer is closed
                    if written:
                        written.result()
                    written, rows = background.submit(writer.write_table, table), []
            if written:
                written.result()


def _row(item: dict, images: dict[str, bool], folder: Path) -> dict[str, Any]:
    """A grasp's values by column; its images are written."""
    row, place = {}, f"{item['object']}/{item['grasp']}"
    if images:
        (folder / place).mkdir(parents=True)
    for name, values in item.items():
        if name not in images:
            row[name] = values
            continue
        found = {f"{place}/{each}.png": image for each, image in pictures(name, values, images[name]).items()}
        for path, image in found.items():
            (folder / path).write_bytes(png(image))
        several = f"{place}/{name}.png" not in found
        row[f"{name}_file_names" if several else f"{name}_file_name"] = [*found] if several else [*found][0]
    return row


def _column(pyarrow: Any, values: list) -> Any:
    """A column of text, numbers, lists of text, or arrays of one shape, which become nested lists."""
    if not isinstance(values[0], np.ndarray) or values[0].dtype.kind in "UO":
        return pyarrow.array(values)
    stacked = np.stack(values)
    column = pyarrow.array(stacked.ravel())
    for length in reversed(stacked.shape[1:]):
        column = pyarrow.FixedSizeListArray.from_arrays(column, length)
    return column
