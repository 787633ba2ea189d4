"""Frames as the reader, items for training and exports give them."""

import tarfile

import numpy as np
import pytest

import palpate
from palpate.interchange import export
from palpate.store import StoreError
from palpate.touch import shade
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
            np.testing.assert_array_equal(frames.vision_camera.matrix(), grasp.vision_camera.matrix())
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


def test_samples_of_webdataset_have_frames(framed, tmp_path):
    export(framed, tmp_path / "out", "webdataset", ["frames_time", "frames_reading"])
    with tarfile.open(tmp_path / "out/test-000000.tar") as shard:
        names = shard.getnames()
    assert sum("frames_reading" in name for name in names) == 2 * 3 * 4 and "00000004.frames_time.npy" in names
