"""Open-X-Tactile's Zarr stores, read by their published layout: headers as JSON, chunks with numcodecs alone."""

import json

import numcodecs
import numpy as np
import pytest
from scipy.linalg import logm

import palpate
from palpate.interchange import export
from palpate.interchange.open_x_tactile import write_open_x_tactile


def read(path):
    """An array of Zarr format 2, chunk by chunk along its first axis."""
    header = json.loads((path / ".zarray").read_text())
    (length, *shape), (step, *chunk) = header["shape"], header["chunks"]
    assert header["zarr_format"] == 2 and chunk == shape and header["order"] == "C" and not header["filters"]
    codec = numcodecs.get_codec(header["compressor"])
    assert header["fill_value"] is None  # of another, xarray makes NaN
    values = np.empty((-(-length // step) * step, *shape), header["dtype"])
    for number in range(len(values) // step):
        file = path / ".".join(map(str, [number, *[0] * len(shape)]))
        content = np.frombuffer(codec.decode(file.read_bytes()), header["dtype"])
        values[number * step : (number + 1) * step] = content.reshape(step, *shape)
    return values[:length]


def test_frames_are_the_grasps(built, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.interchange.open_x_tactile.FRAMES", 3)  # so that the last chunk is cut
    dataset, out = palpate.Dataset(built), tmp_path / "out"
    assert export(dataset, out, "open_x_tactile") == 6
    renamed = {"camera_main_rgb": "occluded", "left_tactile_data_fingers": "reading"}
    of_layout = {"timestamps", "sub_task_instruction", "left_wrist_pose", "left_tactile_area_fingers"}
    of_layout |= {"left_tactile_sensor_fingers", "left_tactile_type_fingers"}
    for split in ("train", "validation", "test"):
        groups = [(out / f"{split}.zarr" / group).iterdir() for group in ("data", "grasps", "meta")]
        data, rest, meta = ({path.name: read(path) for path in paths if path.is_dir()} for paths in groups)
        grasps = dataset.grasps(split)
        assert list(meta["episode_ends"]) == list(range(1, len(grasps) + 1))
        assert {len(values) for values in [*data.values(), *rest.values()]} == {len(grasps)}
        assert set(data) == {*renamed, *of_layout}
        assert set(rest) == {*grasps.sources, "object", "grasp"} - {*renamed.values(), "palm_pose"}
        for number in range(len(grasps)):
            item, frame = grasps[number], {name: values[number] for name, values in (data | rest).items()}
            assert (frame.pop("object"), frame.pop("grasp")) == (item["object"], item["grasp"])
            for name in set(frame) - of_layout:
                expected = item[renamed.get(name, name)]
                np.testing.assert_array_equal(frame[name], expected, err_msg=name)
                assert frame[name].dtype == expected.dtype
            assert frame["sub_task_instruction"] == f"grasp the {item['class']}" and frame["timestamps"] == 0
            assert list(frame["left_tactile_area_fingers"]) == [1, 2, 3, 0]  # index, middle, ring, thumb
            assert (frame["left_tactile_sensor_fingers"], frame["left_tactile_type_fingers"]) == ("digit", "image")
            turn = logm(item["palm_pose"][:3, :3]).real
            expected = [*item["palm_pose"][:3, 3], turn[2, 1], turn[0, 2], turn[1, 0]]
            np.testing.assert_allclose(frame["left_wrist_pose"], expected, atol=1e-7)
    card = (out / "README.md").read_text()
    assert "| sensor, row, column, colour | `data/left_tactile_data_fingers` |" in card
    assert "| sensor, row, column | `grasps/depth` |" in card and "| `data/left_wrist_pose` |" in card
    assert "train.zarr/grasps/depth/.zarray" in (out / "SHA256SUMS").read_text()


def test_axes_have_names_by_which_xarray_opens_it(built, tmp_path):
    dataset, out = palpate.Dataset(built), tmp_path / "out"
    export(dataset, out, "open_x_tactile")
    axes = {
        path.parent.name: json.loads(path.read_text())["_ARRAY_DIMENSIONS"]
        for path in (out / "train.zarr").glob("*/*/.zattrs")
    }
    assert axes["left_tactile_data_fingers"] == ["frame", "sensor", "row", "column", "colour"]
    assert axes["depth"] == ["episode", "sensor", "row", "column"] and axes["episode_ends"] == ["episode"]
    assert axes["penetration"] == ["episode"] and axes["camera_main_rgb"][1:3] == ["image_row", "image_column"]
    xarray = pytest.importorskip("xarray", reason="no xarray here (envs/xarray.in)")
    found = xarray.open_zarr(out / "train.zarr", group="grasps", consolidated=False, chunks=None)
    item = dataset.grasps("train")[1]
    for name in ("depth", "touches", "penetration", "link_pose", "object"):
        np.testing.assert_array_equal(found[name].values[1], item[name], err_msg=name)
        assert found[name].dtype == np.asarray(item[name]).dtype or name == "object"


def test_all_cameras_are_kept(built, tmp_path):
    grasps = palpate.Dataset(built).grasps("test", ["occluded"], camera=None)
    write_open_x_tactile(tmp_path, {"test": grasps})
    images = read(tmp_path / "test.zarr/grasps/occluded")
    np.testing.assert_array_equal(images, [grasps[0]["occluded"], grasps[1]["occluded"]])
    np.testing.assert_array_equal(read(tmp_path / "test.zarr/data/camera_main_rgb"), images[:, 0])


@pytest.mark.parametrize("names, areas", [(["upper_gel", "lower_gel"], [0, 1]), (["thumb", "index", "palm"], None)])
def test_areas_of_other_hands(built, tmp_path, names, areas):
    (tmp_path / "sensor.json").write_text(json.dumps({"names": names, "sensor": {"name": "digit"}}))
    splits = {"test": palpate.Dataset(built).grasps("test", ["reading"])}
    if areas is None:
        with pytest.raises(ValueError, match="areas of thumb, index, .* sensors are called thumb, index, palm"):
            write_open_x_tactile(tmp_path, splits)
    else:
        write_open_x_tactile(tmp_path, splits)
        assert read(tmp_path / "test.zarr/data/left_tactile_area_fingers").tolist() == [areas] * 2
