"""Parquet and a folder of images a split, as `datasets.load_dataset(<folder>)` of Hugging Face reads them.

<folder>/<split>/metadata.parquet                    a row a grasp; columns `<array>_file_name` name images
        /<split>/<object>/<grasp>/<array>.png        what every export has: palpate.interchange.folder
"""

import itertools
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from palpate.dataset import GraspDataset
from palpate.interchange.items import TEXT, Layout, pictures, png, with_progress

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
        path, items = folder / split / "metadata.parquet", with_progress(grasps, split)
        first, _ = _row(grasps[0], grasps)
        # Numbers hardly repeat: dictionaries of them take longer, and more bytes.
        how = {"compression": "zstd", "use_dictionary": False, "use_byte_stream_split": _bytes_apart(first)}
        running: list[Future[None]] = []
        with (
            parquet.ParquetWriter(path, _table(pyarrow, [first]).schema, **how) as writer,
            ThreadPoolExecutor(2) as background,  # encodes and compresses while the next rows are read
        ):
            while batch := [_row(item, grasps) for item in itertools.islice(items, ROWS)]:
                table = _table(pyarrow, [row for row, _ in batch])
                for task in running:
                    task.result()
                running = [background.submit(writer.write_table, table)]
                for _, images in batch:
                    running += [background.submit(_write_png, folder / split / name, images[name]) for name in images]
            for task in running:
                task.result()


def _names(name: str, images: list[str]) -> list[str]:
    """The column of an array; of images, that of their files' names."""
    return [f"{name}_file_name{'s' * (images != [name])}" if images else name]


def _row(item: dict[str, Any], grasps: GraspDataset) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """A grasp's values by column, and its images by path."""
    row = {name: item[name] for name in (*TEXT, grasps.unit)}
    images: dict[str, np.ndarray] = {}
    for name in grasps.arrays:
        own = pictures(grasps, name, item[name])
        files = {f"{item['object']}/{item[grasps.unit]}/{key}.png": image for key, image in own.items()}
        (column,) = _names(name, [*own])
        row[column] = [*files] if column.endswith("_file_names") else next(iter(files), item[name])
        images |= files
    return row, images


def _write_png(path: Path, image: np.ndarray) -> None:
    """Write an image into a folder that need not be there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png(image))


def _bytes_apart(row: dict[str, Any]) -> list[str]:
    """Parquet's paths of the columns of arrays of floating-point numbers, whose first bytes are stored together, then
    the second (BYTE_STREAM_SPLIT): they take a third less. Single numbers stay as every reader has them."""
    arrays = {name: value for name, value in row.items() if isinstance(value, np.ndarray) and value.ndim}
    return [name + ".list.element" * array.ndim for name, array in arrays.items() if array.dtype in ("f4", "f8")]


def _table(pyarrow: Any, rows: list[dict[str, Any]]) -> Any:
    """Rows as a table of pyarrow."""
    return pyarrow.table({name: _column(pyarrow, [row[name] for row in rows]) for name in rows[0]})


def _column(pyarrow: Any, values: list[Any]) -> Any:
    """A column of text, numbers, lists of text, or arrays of one shape, which become nested lists."""
    if not isinstance(values[0], np.ndarray) or values[0].dtype.kind in "UO":
        return pyarrow.array(values)
    stacked = np.stack(values)
    column = pyarrow.array(stacked.ravel())
    for length in reversed(stacked.shape[1:]):
        column = pyarrow.FixedSizeListArray.from_arrays(column, length)
    return column


LAYOUT = Layout("parquet", write_parquet, "{}/**", _names)
