"""Tar shards, read back with the standard library."""

import io
import json
import tarfile
from collections import defaultdict

import numpy as np
import pytest
import yaml
from PIL import Image

import palpate
from palpate.interchange import write_webdataset
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
def test_samples_are_the_grasps(built, tmp_path, shard_bytes):
    dataset = palpate.Dataset(built)
    assert write_webdataset(dataset, tmp_path / "out", shard_bytes=shard_bytes) == 6
    for split in ("train", "validation", "test"):
        grasps = dataset.grasps(split)
        found, shards = samples(tmp_path / "out", split)
        assert shards == (1 if shard_bytes > 1 else len(grasps))
        assert list(found) == [f"{number:08d}" for number in range(len(grasps))]
        for files, item in zip(found.values(), (grasps[number] for number in range(len(grasps))), strict=True):
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


def test_the_same_run_gives_the_same_bytes(built, tmp_path):
    for name in ("a", "b"):
        write_webdataset(palpate.Dataset(built), tmp_path / name, ["reading", "penetration"])
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


def test_an_export_that_fails_leaves_nothing(built, tmp_path, monkeypatch):
    dataset = palpate.Dataset(built)
    with pytest.raises(KeyError, match="no array 'gel' of grasps; there are"):
        write_webdataset(dataset, tmp_path / "out", ["gel"])
    with pytest.raises(StoreError, match="no object"):
        write_webdataset(dataset[:0], tmp_path / "out")
    monkeypatch.setattr("palpate.interchange.webdataset.write_card", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_webdataset(dataset, tmp_path / "out", ["success"])
    assert not list(tmp_path.iterdir())


def test_the_card_says_what_is_in_it(run, tmp_path):
    config = {"run": "small", "results": "/home/me/results", "source": {"kind": "folder", "path": "/home/me/mugs"}}
    (run / "config.yaml").write_text(yaml.safe_dump(config))
    (run / "evaluations/charts_touch").mkdir(parents=True)
    (run / "evaluations/charts_touch/seed-0.csv").write_text("split,chamfer\ntest,2\ntest,4\nvalidation,100\n")
    (run / "reports").mkdir()
    (run / "reports/validation.csv").write_text("check,passed\nfiles,True\nfinite,False\n")
    write_webdataset(palpate.Dataset(run), tmp_path / "out", ["reading"], licence="cc-by-4.0", source="my mugs")
    text = (tmp_path / "out/README.md").read_text()
    _, header, body = text.split("---\n", 2)
    header = yaml.safe_load(header)
    assert header["license"] == "cc-by-4.0" and header["size_categories"] == ["n<1K"]
    patterns = {each["split"]: each["path"] for each in header["configs"][0]["data_files"]}
    for split, pattern in patterns.items():
        assert [path.name for path in (tmp_path / "out").glob(pattern)] == [f"{split}-000000.tar"]
    for line in (
        "6 simulated grasps of 3 objects",
        "- Licence of the data: cc-by-4.0.",
        "- Source of the meshes: my mugs.",
        "| ball | 1 | 1 | 0 |",
        "| block | 0 | 0 | 1 |",
        "2 grasps an object.",
        "| `reading` | (4, 100, 100, 3) | uint8 | RGB |",
        "| 1 | grasps | too few grasps |",
        "2 checks of files and values: 1 failed.",
        "| charts_touch | seed-0 | 2 | 3 |",
    ):
        assert line in body, line
    assert "path: mugs" in body and "/home/me" not in body  # nothing of this machine
