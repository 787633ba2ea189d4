"""Presses as the reader, items for training, exports and the viewer give them."""

import csv
import json
import tarfile

import numpy as np
import pytest

import palpate
from palpate.dataset.validation import validate_batch
from palpate.interchange import export
from palpate.mesh import OBJECT_POSITION, load_geometry
from palpate.mesh.distance import Surface
from palpate.store import StoreError, read
from palpate.viewer.page import object_page
from tests.store.conftest import add_presses


@pytest.fixture
def pressed(run):
    add_presses(run)
    return palpate.Dataset(run)


def test_an_object_has_its_presses(pressed):
    for record in pressed:
        store = read(pressed.folder / f"press/{record.batch}.zarr")
        row = store["object"].tolist().index(record.name)
        assert [press.number for press in record.presses] == [0, 1]
        for press in record.presses:
            for name in ("point", "position", "depth", "reading", "pressure", "force", "approach"):
                np.testing.assert_array_equal(getattr(press, name), store[name][row, press.number], err_msg=name)
            np.testing.assert_array_equal(press.vision_camera.matrix(), record.vision_camera.matrix())
            assert press.object.name == record.name and press.sensor.name == "digit"
            away, _ = Surface(*load_geometry(record.mesh)).closest(press.points.astype(float) - OBJECT_POSITION)
            assert len(press.points) == np.isfinite(press.depth).sum() > 0 and away.max() < 1e-6
    assert pressed.array("press", "reading")[:, 1, 2].shape == (len(pressed), 100, 100, 3)
    assert not {"point", "reading"} & {*type(record).stage_of}  # an object's own arrays


def test_a_run_without_presses_says_how_to_make_them(built):
    for ask in (lambda dataset: dataset[0].presses, lambda dataset: dataset.presses()):
        with pytest.raises(StoreError, match="has no press; build it with: snakemake"):
            ask(palpate.Dataset(built))
    assert "press_point" not in palpate.Dataset(built).grasps().arrays


def test_they_pass_their_checks(pressed):
    findings = [found for found in validate_batch(pressed.folder, "batch-0000") if found.store == "press"]
    assert all(found.ok for found in findings)
    assert {"pressed", "press pose", "outside", "on mesh", "reading"} <= {found.check for found in findings}


def test_items_for_training_are_presses(pressed):
    items = pressed.presses("test", ["reading", "force"])
    record = pressed.split("test")[0]
    assert len(items) == 2 and items[1]["press"] == 1 and items[1]["object"] == record.name
    np.testing.assert_array_equal(items[1]["reading"], record.presses[1].reading)
    assert items.dimensions("reading") == ("force_step", "row", "column", "colour") and items.images == {
        "reading": True
    }
    assert not {*pressed.grasps().arrays} & {"pressure", "approach"}  # samples of grasps don't repeat them
    with pytest.raises(IndexError, match="press 2 of 2"):
        items[2]
    with pytest.raises(KeyError, match="array of presses"):
        pressed.presses(arrays=["presure"])


def test_exports_have_a_sample_a_press(pressed, tmp_path):
    zarr = pytest.importorskip("zarr")
    assert export(pressed, tmp_path / "tar", "webdataset", samples="presses") == 6
    with tarfile.open(tmp_path / "tar/test-000000.tar") as shard:
        names = shard.getnames()
        numbers = [json.load(shard.extractfile(name))["press"] for name in names if name.endswith(".json")]
    assert numbers == [0, 1] and sum(".reading." in name for name in names) == 2 * 3
    with (tmp_path / "tar/presses.csv").open() as table:
        assert [row["press"] for row in csv.DictReader(table)] == ["0", "1"] * 3
    assert "6 simulated presses of 3 objects" in (tmp_path / "tar/README.md").read_text()
    described = json.loads((tmp_path / "tar/croissant.json").read_text())
    assert "presses" in {table["name"] for table in described["recordSet"]}
    export(pressed, tmp_path / "zarr", "zarr", ["pressure", "force"], samples="presses")
    group = zarr.open_group(tmp_path / "zarr/test.zarr", mode="r")
    np.testing.assert_array_equal(group["pressure"][1], pressed.split("test")[0].presses[1].pressure)
    assert group["force"].metadata.dimension_names == ("press", "force_step")


def test_parquet_has_a_row_a_press(pressed, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    export(pressed, tmp_path / "out", "parquet", ["reading", "force"], samples="presses")
    rows = parquet.read_table(tmp_path / "out/test/metadata.parquet").to_pylist()
    assert [row["press"] for row in rows] == [0, 1] and rows[0]["force"] == [0.5, 1.0, 2.0]
    assert all((tmp_path / "out/test" / name).is_file() for name in rows[1]["reading_file_names"])


def test_the_page_of_an_object_has_its_presses(pressed, tmp_path):
    record = pressed[0]
    object_page(tmp_path / "page.html", record)
    text = (tmp_path / "page.html").read_text()
    data = json.loads(text.split('<script id="page" type="application/json">')[1].split("</script>")[0])
    shown = data["presses"]["1"]
    press = record.presses[1]
    poses = np.reshape(shown["poses"], (3, 3, 4))
    away = np.linalg.norm(poses[:, :, 3] - press.position, axis=1)
    np.testing.assert_allclose(away, press.approach, atol=2e-6)  # it goes on with the force
    assert [line.split(",")[0] for line in shown["lines"]] == ["0.5 N", "1 N", "2 N"] and len(shown["readings"]) == 3
