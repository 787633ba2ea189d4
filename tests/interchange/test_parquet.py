"""Parquet and images, read back with pyarrow; it is not among the locked packages (envs/parquet.in)."""

import sys

import numpy as np
import pytest
from PIL import Image

import palpate
from palpate.interchange import export


def test_rows_are_the_grasps(built, tmp_path, monkeypatch):
    parquet = pytest.importorskip("pyarrow.parquet", reason="no pyarrow here (envs/parquet.in)")
    monkeypatch.setattr("palpate.interchange.layouts.ROWS", 1)  # so that a split is written in parts
    dataset = palpate.Dataset(built)
    assert export(dataset, tmp_path / "out", "parquet") == 6
    for split in ("train", "validation", "test"):
        table = parquet.read_table(tmp_path / "out" / split / "metadata.parquet")
        parts = parquet.read_metadata(tmp_path / "out" / split / "metadata.parquet").row_group(0)
        columns = [parts.column(number) for number in range(parts.num_columns)]
        assert {each.path_in_schema.split(".")[0] for each in columns if "BYTE_STREAM_SPLIT" in each.encodings} == {
            name
            for name, values in dataset.grasps(split)[0].items()
            if isinstance(values, np.ndarray) and values.ndim and values.dtype in ("f4", "f8")
        }
        grasps = dataset.grasps(split)
        assert table.num_rows == len(grasps)
        for number, row in enumerate(table.to_pylist()):
            item = grasps[number]
            assert [row[name] for name in ("object", "class", "split", "grasp")] == [
                item[name] for name in ("object", "class", "split", "grasp")
            ]
            for name in ("points", "depth", "palm_pose", "success", "penetration", "attempts", "occluded_depth"):
                np.testing.assert_array_equal(np.array(row[name], item[name].dtype), item[name], err_msg=name)
            paths = [row["occluded_file_name"], *row["reading_file_names"]]
            for path, image in zip(paths, [item["occluded"], *item["reading"]], strict=True):
                with Image.open(tmp_path / "out" / split / path) as picture:
                    np.testing.assert_array_equal(np.asarray(picture), image)
    assert (tmp_path / "out/README.md").read_text().startswith("---\nlicense: unknown\n")


def test_without_pyarrow_it_says_what_to_install(built, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ImportError, match="Parquet needs pyarrow: pip install"):
        export(palpate.Dataset(built), tmp_path / "out", "parquet")
    assert not list(tmp_path.iterdir())
