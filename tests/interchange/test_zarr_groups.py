"""Exports in Zarr: the arrays of the reader's items, with names of their axes."""

import numpy as np
import pytest
import zarr

import palpate
from palpate.interchange import export


def test_arrays_are_those_of_the_items_with_names_of_their_axes(built, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.interchange.layouts.CHUNK", 1)  # so that rows are appended
    dataset = palpate.Dataset(built)
    assert export(dataset, tmp_path / "out", "zarr") == 6
    for split in palpate.catalogue.SPLITS:
        group, items = zarr.open_group(tmp_path / f"out/{split}.zarr", mode="r"), list(dataset.grasps(split))
        assert set(group) == set(items[0])
        for name, array in group.arrays():
            assert array.metadata.dimension_names[0] == "grasp" and array.ndim == len(array.metadata.dimension_names)
            np.testing.assert_array_equal(array[:], np.array([item[name] for item in items]))
    depth = zarr.open_group(tmp_path / "out/train.zarr", mode="r")["depth"]
    assert depth.metadata.dimension_names == ("grasp", "sensor", "row", "column") and depth.attrs["unit"] == "m"


def test_xarray_opens_it(built, tmp_path):
    xarray = pytest.importorskip("xarray", reason="no xarray here (envs/xarray.in)")
    dataset = palpate.Dataset(built)
    export(dataset, tmp_path / "out", "zarr")
    opened = xarray.open_zarr(tmp_path / "out/train.zarr", consolidated=False)
    items = list(dataset.grasps("train"))
    assert opened.sizes["grasp"] == len(items) and list(opened["object"].values) == [item["object"] for item in items]
    np.testing.assert_array_equal(opened["depth"], [item["depth"] for item in items])
