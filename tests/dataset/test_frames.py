"""Frames as the reader, items for training and exports give them."""

import json
import tarfile

import numpy as np
import pytest

import palpate
from palpate.interchange import export
from palpate.store import StoreError
from palpate.touch import shade
from tests.interchange.test_open_x_tactile import read
from tests.store.conftest import add_frames

NAMES = ("joint_positions", "link_pose", "sensor_position", "sensor_rotation", "success", "depth", "reading")


@pytest.fixture
def framed(run):
    add_frames(run)
    return palpate.Dataset(run)


def test_a_grasp_has_its_frames(framed):
    for record in framed:
        for grasp in record.grasps:
            frames = grasp.frames
            assert len(frames) == 3 and frames.has_touch and repr(frames).endswith(f"{grasp.number})")
            for name in NAMES:
                values = getattr(frames, name)
                assert len(values) == 3
                np.testing.assert_array_equal(values[-1], getattr(grasp, name), err_msg=name)
            np.testing.assert_array_equal(frames.occluded[1], grasp.occluded)
            for touched in zip(*np.nonzero(frames.success), strict=True):
                np.testing.assert_array_equal(frames.reading[touched], shade(frames.depth[touched], grasp.sensor))


def test_nothing_is_opened_before_it_is_asked_for(built):
    frames = palpate.Dataset(built)[0].grasps[0].frames  # of a run without any
    with pytest.raises(StoreError, match="has no frames; build it with: snakemake"):
        len(frames)
    assert not [name for name in palpate.Dataset(built).grasps().arrays if name.startswith("frames_")]


def test_items_for_training_have_frames(framed):
    grasps = framed.grasps("test")
    record = framed.split("test")[0].grasps[1]
    for name in ("time", "depth", "reading", "link_pose", "occluded", "image_frame"):
        np.testing.assert_array_equal(grasps[1][f"frames_{name}"], getattr(record.frames, name), err_msg=name)
    assert grasps.images["frames_reading"] and grasps.images["frames_occluded"]


def test_an_episode_of_open_x_tactile_is_a_closing(framed, tmp_path):
    export(framed, tmp_path / "out", "open_x_tactile")
    store, (record,) = tmp_path / "out/test.zarr", framed.split("test")
    data, frames = store / "data", [grasp.frames for grasp in record.grasps]
    assert read(store / "meta/episode_ends").tolist() == [3, 6]
    assert read(data / "timestamps").tolist() == [0, 1, 2, 0, 1, 2]
    expected = np.concatenate([each.reading for each in frames])
    np.testing.assert_array_equal(read(data / "left_tactile_data_fingers"), expected)
    np.testing.assert_array_equal(read(store / "frames/depth"), np.concatenate([each.depth for each in frames]))
    np.testing.assert_array_equal(read(store / "grasps/reading"), [grasp.reading for grasp in record.grasps])
    assert len(read(data / "left_wrist_pose")) == len(read(data / "sub_task_instruction")) == 6
    assert not (data / "camera_main_rgb").exists()  # two of three frames have images
    assert read(store / "grasps/frames_occluded").shape[:2] == (2, 2)
    card = (tmp_path / "out/README.md").read_text()
    assert "| frame, sensor, row, column, colour | `data/left_tactile_data_fingers` |" in card
    assert "| frame, sensor, row, column | `frames/depth` |" in card
    assert "| `grasps/frames_occluded` |" in card and "| `grasps/reading` |" in card
    header = json.loads((store / "frames/depth/.zattrs").read_text())
    assert header["_ARRAY_DIMENSIONS"] == ["frame", "sensor", "row", "column"]


def test_samples_of_webdataset_have_frames(framed, tmp_path):
    export(framed, tmp_path / "out", "webdataset", ["frames_time", "frames_reading"])
    with tarfile.open(tmp_path / "out/test-000000.tar") as shard:
        names = shard.getnames()
    assert sum("frames_reading" in name for name in names) == 2 * 3 * 4 and "00000004.frames_time.npy" in names
