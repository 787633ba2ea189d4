"""Tar shards, read back with the standard library."""

import csv
import io
import json
import tarfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import palpate
from palpate.interchange import export
from palpate.store import StoreError


def samples(folder, split):
    """Files of each sample by its key, in order, and the number of shards."""
    found, shards = defaultdict(dict), sorted(folder.glob(f"{split}-*.tar"))
    for shard in shards:
        with tarfile.open(shard) as tar:
            for entry in tar:
                key, _, name = entry.name.partition(".")
                found[key][name] = tar.extractfile(entry).read()
    return found, len(shards)


def picture(data):
    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image)


@pytest.mark.parametrize("shard_bytes", [1, 10**9])
def test_samples_are_the_grasps(built, tmp_path, monkeypatch, shard_bytes):
    monkeypatch.setattr("palpate.interchange.layouts.SHARD_BYTES", shard_bytes)
    dataset = palpate.Dataset(built)
    assert export(dataset, tmp_path / "out") == 6
    with (tmp_path / "out/grasps.csv").open() as file:
        table = {row["sample"]: row for row in csv.DictReader(file)}
    before = 0
    for split in ("train", "validation", "test"):
        grasps = dataset.grasps(split)
        found, shards = samples(tmp_path / "out", split)
        assert shards == (1 if shard_bytes > 1 else len(grasps))
        assert list(found) == [f"{before + number:08d}" for number in range(len(grasps))]
        before += len(grasps)
        for files, item in zip(found.values(), (grasps[number] for number in range(len(grasps))), strict=True):
            row = table.pop(next(key for key, each in found.items() if each is files))
            assert row == {name: str(item.get(name, row["sample"])) for name in row}
            described = json.loads(files.pop("json"))
            assert described == {name: item[name] for name in ("object", "class", "split", "grasp")}
            for name in ("unoccluded", "occluded_mask"):
                np.testing.assert_array_equal(picture(files.pop(f"{name}.png")), item[name])
            for sensor in range(4):
                np.testing.assert_array_equal(picture(files.pop(f"reading.{sensor}.png")), item["reading"][sensor])
            for name in ("points", "depth", "palm_pose", "occluded_depth", "attempts", "surface_points"):
                values = np.load(io.BytesIO(files.pop(f"{name}.npy")))
                np.testing.assert_array_equal(values, item[name])
                assert values.dtype == item[name].dtype
    assert not table


def test_the_same_run_gives_the_same_bytes(built, tmp_path):
    for name in ("a", "b"):
        export(palpate.Dataset(built), tmp_path / name, arrays=["reading", "penetration"])
    for path in filter(Path.is_file, (tmp_path / "a").rglob("*")):
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes(), path.name


def test_an_export_that_fails_leaves_nothing(built, tmp_path, monkeypatch):
    dataset = palpate.Dataset(built)
    with pytest.raises(KeyError, match="array of grasps: 'gel' is not one of"):
        export(dataset, tmp_path / "out", arrays=["gel"])
    with pytest.raises(StoreError, match="no object"):
        export(dataset[:0], tmp_path / "out")
    monkeypatch.setattr("palpate.interchange.folder.write_card", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        export(dataset, tmp_path / "out", arrays=["success"])
    assert not list(tmp_path.iterdir())
