"""What every export has beside its samples."""

import csv
import fnmatch
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tarfile

import numpy as np
import pytest
import yaml
import zarr
from PIL import Image

import palpate
from palpate import seal
from palpate.atomic import remove
from palpate.catalogue import file_name
from palpate.dataset.run import Run
from palpate.interchange import export
from palpate.interchange.layouts import FORMATS, Contents, samples_by_split
from palpate.sensor import DIGIT, Sensor
from palpate.store import CONTRACT, StoreError, read, write
from tests.store.conftest import ATTRIBUTES, BATCHES


@pytest.fixture(scope="module")
def exported(built, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports") / "out"
    export(palpate.Dataset(built), folder)
    return folder


def files_of(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_sums_are_of_all_files_and_sha256sum_takes_them(exported):
    lines = (exported / "SHA256SUMS").read_text().splitlines()
    assert {line.split("  ", 1)[1] for line in lines} == files_of(exported) - {"SHA256SUMS", "seal.json"}
    subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=exported, check=True)


def test_each_object_has_its_mesh(built, exported):
    with (exported / "objects.csv").open() as file:
        rows = {row["object"]: row for row in csv.DictReader(file)}
    dataset = palpate.Dataset(built)
    assert list(rows) == dataset.objects
    for record in dataset:
        row = rows[record.name]
        assert (row["class"], row["split"]) == (record.class_name, record.split)
        assert (exported / row["mesh"]).read_bytes() == (record.mesh / "visual.glb").read_bytes()
    assert len(list((exported / "meshes").iterdir())) == len(rows)


def test_the_sensor_can_be_read_back(exported):
    found = json.loads((exported / "sensor.json").read_text())
    assert Sensor.from_description(found["sensor"]).geometry_difference(DIGIT) == ""
    assert found["names"] == ["index", "middle", "ring", "thumb"]


def test_figures_of_classes_with_spaces_and_signs_are_copied(run, tmp_path, monkeypatch):
    name = "mugs (large)"
    (run / "figures").mkdir()
    (run / f"figures/examples_{file_name(name)}.png").write_bytes(b"a figure")
    monkeypatch.setattr(palpate.Dataset, "classes", [name])
    export(palpate.Dataset(run), tmp_path / "out", arrays=["success"])
    assert [figure.read_bytes() for figure in (tmp_path / "out/figures").iterdir()] == [b"a figure"]


def test_the_example_of_an_export_is_read_once(built):
    dataset = palpate.Dataset(built)
    contents = Contents(dataset, samples_by_split(dataset, ["success"]), FORMATS["zarr"], "unknown", "")
    assert contents.example is contents.example


@pytest.mark.parametrize("damage", ["change", "remove"])
def test_a_mesh_that_is_not_the_one_that_was_written_is_an_error(run, tmp_path, damage):
    path = run / "meshes/batch-0000/block-0000/visual.glb"
    content = path.read_bytes()
    path.unlink()
    if damage == "change":
        path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(
        seal.DamagedFile, match="block-0000/visual.glb (is missing|has changed .*); remove .*batch-0000"
    ):
        export(palpate.Dataset(run), tmp_path / "out", arrays=["success"])
    assert not list(tmp_path.glob("*out*"))


def test_batches_with_different_sensors_are_an_error(run, tmp_path):
    path = run / CONTRACT["touch"].path("batch-0001")
    arrays = read(path)
    other = DIGIT.description() | {"diffuse": 100}
    write(path, "touch", arrays, ATTRIBUTES | {"sensor": other})
    with pytest.raises(StoreError, match="'block-0000', 0.*'ball-0002', 0.* have different sensors"):
        export(palpate.Dataset(run), tmp_path / "out", arrays=["success"])
    assert len(BATCHES) == 2 and not list(tmp_path.glob("*out*"))


KILLED = """
import os, signal, sys
import palpate
from palpate.interchange import export, folder
folder.write_card = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
export(palpate.Dataset(sys.argv[1]), sys.argv[2], arrays=["success"])
"""


def test_a_killed_export_leaves_nothing_that_looks_finished(built, tmp_path):
    command = [sys.executable, "-c", KILLED, built, tmp_path / "out"]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    (left,) = os.listdir(tmp_path)
    assert left.startswith(".partial-")
    export(palpate.Dataset(built), tmp_path / "out", arrays=["success"])
    assert os.listdir(tmp_path) == ["out"]


def test_croissant_describes_the_files_and_their_columns(exported):
    text = (exported / "croissant.json").read_text()
    described = json.loads(text)
    assert described["conformsTo"][0] == "http://mlcommons.org/croissant/1.1" and described["name"] == "small"
    nodes = {each["@id"]: each for each in described["distribution"]}
    for node in nodes.values():
        if node["@type"] == "cr:FileObject":
            size, digest = seal.size_and_sha256(exported / node["contentUrl"])
            assert (node["contentSize"], node["sha256"]) == (f"{size} B", digest)
            continue
        if node["name"] == "meshes":
            assert len(fnmatch.filter(files_of(exported), node["includes"])) == 3
    ids = [*nodes, *(each["@id"] for each in described["recordSet"])]
    tables = [each for each in described["recordSet"] if each["@id"] in ("objects", "grasps")]
    assert len(tables) == 2
    for records in tables:
        for field in records["field"]:
            ids.append(field["@id"])
            source = nodes[field["source"]["fileObject"]["@id"]]
            header = (exported / source["contentUrl"]).read_text().splitlines()[0].split(",")
            assert source["encodingFormat"] == "text/csv" and field["source"]["extract"]["column"] in header
    assert len(ids) == len(set(ids))


def arrays_of(folder):
    """Of the record sets of croissant.json the fields of arrays by their ids, and the sets of files by theirs."""
    described = json.loads((folder / "croissant.json").read_text())
    sets = {each["@id"]: each for each in described["distribution"] if each["@type"] == "cr:FileSet"}
    fields = {field["@id"]: field for records in described["recordSet"] for field in records["field"]}
    return {name: field for name, field in fields.items() if "fileSet" in field["source"]}, sets


def shape_of(field):
    assert field.get("isArray", False) == ("arrayShape" in field)
    return tuple(map(int, field["arrayShape"].split(","))) if "arrayShape" in field else ()


TYPES = {"sc:Boolean": "bool"} | {
    f"cr:{name}": name.lower() for name in ("Float16", "Float32", "Float64", "UInt8", "Int8", "Int32", "Int64")
}


def test_croissant_has_type_and_shape_of_what_is_in_the_archives(built, exported):
    fields, sets = arrays_of(exported)
    item, names = palpate.Dataset(built).grasps("train")[0], set()
    for name in ("train", "validation", "test"):
        with tarfile.open(exported / f"{name}-000000.tar") as tar:
            names |= set(tar.getnames())
    for name in palpate.Dataset(built).grasps().sources:
        field, files = fields[f"{name}/{name}"], sets[f"{name}-files"]
        assert field["source"] == {"fileSet": {"@id": f"{name}-files"}, "extract": {"fileProperty": "content"}}
        assert files["containedIn"] == [{"@id": f"{split}-000000.tar"} for split in ("test", "train", "validation")]
        found = fnmatch.filter(names, files["includes"])
        assert len(found) == 6 * (4 if name == "reading" else 1)
        assert {re.fullmatch(r"\d+\.([a-z_]+)(\.\d)?\.(png|npy)", each)[1] for each in found} == {name}
        if files["encodingFormat"] == "image/png":
            assert field["dataType"] == "sc:ImageObject" and item[name].dtype == "uint8"
        else:
            assert (TYPES[field["dataType"]], shape_of(field)) == (item[name].dtype.name, item[name].shape)
        regex = fields[f"{name}/sample"]["source"]["transform"]["regex"]
        assert {re.match(regex, each)[1] for each in found} == {f"{number:08d}" for number in range(6)}


def test_croissant_has_type_and_shape_of_arrays_in_zarr(built, tmp_path):
    export(palpate.Dataset(built), tmp_path / "out", "zarr")
    fields, sets = arrays_of(tmp_path / "out")
    assert {name.partition("/")[0] for name in fields} == set(palpate.Dataset(built).grasps().sources)
    for name, field in fields.items():
        files = fnmatch.filter(files_of(tmp_path / "out"), sets[field["source"]["fileSet"]["@id"]]["includes"])
        headers = [tmp_path / "out" / each for each in files if each.endswith("zarr.json")]
        assert len(headers) == 3  # of the splits
        for header in headers:
            array = zarr.open_array(header.parent, mode="r")
            assert (TYPES[field["dataType"]], shape_of(field)) == (array.dtype.name, array.shape[1:]), name


def test_croissant_has_type_and_shape_of_the_columns_in_parquet(built, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="no pyarrow here (envs/parquet.in)")
    export(palpate.Dataset(built), tmp_path / "out", "parquet")
    fields, sets = arrays_of(tmp_path / "out")
    files = fnmatch.filter(files_of(tmp_path / "out"), sets["metadata-files"]["includes"])
    assert len(files) == 3
    for file in files:
        table = parquet.read_table(tmp_path / "out" / file)
        assert [field["source"]["extract"]["column"] for field in fields.values()] == table.column_names
        for name, field in fields.items():
            value = np.array(table.column(name.removeprefix("grasps/"))[0].as_py())
            innermost = table.schema.field(name.removeprefix("grasps/")).type
            while hasattr(innermost, "value_type"):
                innermost = innermost.value_type
            kinds = {"string": "sc:Text", "bool": "sc:Boolean", "halffloat": "cr:Float16", "float": "cr:Float32"}
            expected = {"double": "cr:Float64"} | kinds
            assert field["dataType"] == expected.get(str(innermost), f"cr:{str(innermost).capitalize()}"), name
            assert shape_of(field) == value.shape, name


def about_axis(axis, angle):
    """Rodrigues' formula, by hand."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@pytest.mark.parametrize("layout", ["webdataset", "zarr"])
def test_a_stranger_finds_the_hand_by_the_files_alone(built, tmp_path, layout):
    """Poses of links from the joints, and local clouds from the depths, by what hand.json and sensor.json say."""
    export(palpate.Dataset(built), tmp_path / "out", layout)
    hand, sensor = (json.loads((tmp_path / f"out/{name}.json").read_text()) for name in ("hand", "sensor"))
    item = palpate.Dataset(built).grasps("test")[0]
    poses = [item["palm_pose"]]
    for link, parent in enumerate(hand["link_parent"][1:], start=1):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = hand["link_rotation"][link], hand["link_position"][link]
        if link in hand["joint_link"]:
            joint = hand["joint_link"].index(link)
            pose[:3, :3] = pose[:3, :3] @ about_axis(hand["joint_axis"][joint], item["joint_positions"][joint])
        poses.append(poses[parent] @ pose)
    np.testing.assert_allclose(poses, item["link_pose"], atol=1e-12)
    assert len(hand["joint_names"]) == len(hand["joint_range"]) == 16 and hand["link_names"][0] == "palm"
    assert len(hand["geom_kind"]) == len(hand["geom_size"]) == len(hand["geom_vertices"])
    assert "half extents" in hand["about"] and "parent's frame" in hand["about"]
    (rows, columns), touched = sensor["sensor"]["resolution"], np.flatnonzero(item["success"])
    assert len(touched) and "((column + 0.5) / columns - 0.5) width" in sensor["pixels"]
    y = ((np.arange(columns) + 0.5) / columns - 0.5) * sensor["sensor"]["width"]
    z = ((np.arange(rows) + 0.5) / rows - 0.5) * sensor["sensor"]["height"]
    for number in touched:
        depth, cloud = item["depth"][number], []
        for row, column in zip(*np.nonzero(np.isfinite(depth)), strict=True):
            cloud.append(item["position"][number] + item["rotation"][number] @ [depth[row, column], y[column], z[row]])
        np.testing.assert_allclose(cloud, item["points"][number][: len(cloud)], atol=1e-6)


def test_untouched_reading_and_cameras_are_beside_the_samples(built, exported):
    dataset = palpate.Dataset(built)
    with Image.open(exported / "empty_reading.png") as image:
        np.testing.assert_array_equal(np.asarray(image), dataset.empty_reading)
    cameras = json.loads((exported / "cameras.json").read_text())
    assert list(cameras["objects"]) == dataset.objects and cameras["size"] == 64
    for record in dataset:
        own = cameras["objects"][record.name]
        pixels = np.array(own["intrinsics"][0]) @ np.array(own["extrinsics"][0]) @ np.append(record.points[0], 1)
        column, row = pixels[:2] / pixels[2]
        assert record.unoccluded_mask[int(row), int(column)] == 255  # a point of the surface is in the picture


def test_batches_with_different_hands_are_an_error(run, tmp_path):
    path = run / CONTRACT["grasps"].path("batch-0001")
    arrays = read(path)
    names = arrays["hand/joint_names"].astype("S20")
    names[0] = b"other"
    write(path, "grasps", arrays | {"hand/joint_names": names}, ATTRIBUTES)
    with pytest.raises(StoreError, match="'block-0000', 0.*'ball-0002', 0.* have different hands"):
        export(palpate.Dataset(run), tmp_path / "out", arrays=["success"])


@pytest.mark.parametrize("lost", ["touch", "vision", "surface", "grasps"])
def test_a_lost_store_is_an_error_that_names_the_command(run, tmp_path, lost):
    """Also the only one of its stage, without which a run looks as if the stage had not been asked for."""
    (run / "config.yaml").write_text(yaml.safe_dump({"source": {"kind": "folder", "path": "."}}))
    for batch in BATCHES:
        remove(run / CONTRACT[lost].path(batch))
    with pytest.raises(StoreError, match=f"has no {lost}; build it with: snakemake {lost}/batch-0000"):
        export(palpate.Dataset(run), tmp_path / "out")
    assert not list(tmp_path.glob("*out*"))
    other = {"touch": "occluded", "vision": "depth", "surface": "depth", "grasps": "depth"}[lost]
    assert export(palpate.Dataset(run), tmp_path / "out", arrays=[other]) == 6


def test_a_lost_store_of_one_batch_is_an_error(run, tmp_path):
    shutil.rmtree(run / "vision/batch-0001.zarr")
    with pytest.raises(StoreError, match="vision/batch-0001.zarr does not exist; build it with: snakemake vision/"):
        export(palpate.Dataset(run), tmp_path / "out")
    assert not list(tmp_path.glob("*out*"))


def test_a_released_dataset_has_no_hands_and_lacks_none(run, tmp_path):
    (run / "config.yaml").write_text(yaml.safe_dump({"source": {"kind": "released", "path": "."}}))
    shutil.rmtree(run / "grasps")
    assert Run(run).asked_stores == ("surface", "touch", "vision")
    assert export(palpate.Dataset(run), tmp_path / "out") == 6
    files = files_of(tmp_path / "out")
    assert (
        "sensor.json" in files
        and "hand.json" not in files
        and "| joint |" not in (tmp_path / "out/README.md").read_text()
    )


def test_no_one_s_folder_is_replaced(built, tmp_path):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.tex").write_text("years")
    (tmp_path / "link").symlink_to(mine)
    for path in (mine, mine / "thesis.tex", tmp_path / "link", built):
        with pytest.raises(FileExistsError, match=f"{path} exists: name a new folder, or remove it"):
            export(palpate.Dataset(built), path, arrays=["success"])
    assert (mine / "thesis.tex").read_text() == "years" and (built / "catalogue.csv").exists()
    (tmp_path / "empty").mkdir()
    assert export(palpate.Dataset(built), tmp_path / "empty", arrays=["success"]) == 6
    with pytest.raises(FileExistsError):  # an earlier export, too
        export(palpate.Dataset(built), tmp_path / "empty", arrays=["success"])


def test_a_folder_that_appears_meanwhile_is_kept(built, tmp_path, monkeypatch):
    def appear(*_):
        (tmp_path / "out").mkdir()
        (tmp_path / "out/file").write_text("mine")

    monkeypatch.setattr("palpate.interchange.folder.write_card", appear)
    monkeypatch.setattr("palpate.interchange.folder.CARD", "croissant.json")
    with pytest.raises(FileExistsError):
        export(palpate.Dataset(built), tmp_path / "out", arrays=["success"])
    assert (tmp_path / "out/file").read_text() == "mine" and os.listdir(tmp_path) == ["out"]


# Properties of the specification of responsible AI, version 1.0; those that have many values.
MANY = {
    *("dataCollectionType", "dataCollectionTimeframe", "dataPreprocessingProtocol", "dataAnnotationProtocol"),
    *("dataAnnotationPlatform", "dataAnnotationAnalysis", "annotatorDemographics", "machineAnnotationTools"),
    *("dataBiases", "dataUseCases", "dataLimitations", "personalSensitiveInformation"),
}
ONE = {
    *("dataCollection", "dataCollectionMissingData", "dataCollectionRawData", "dataImputationProtocol"),
    *("dataManipulationProtocol", "annotationsPerItem", "dataSocialImpact", "dataReleaseMaintenancePlan"),
}


def test_responsible_ai_is_stated_in_the_specification_s_words(built, exported):
    described = json.loads((exported / "croissant.json").read_text())
    assert "http://mlcommons.org/croissant/RAI/1.0" in described["conformsTo"]
    assert described["@context"]["rai"] == "http://mlcommons.org/croissant/RAI/"
    stated = {name.removeprefix("rai:"): value for name, value in described.items() if name.startswith("rai:")}
    assert len(stated) >= 10 and not set(stated) - MANY - ONE
    for name, value in stated.items():
        texts = value if name in MANY else [value]
        assert isinstance(texts, list) and texts and all(isinstance(text, str) and text for text in texts), name
    assert "Objects by class: ball 2, block 1." in stated["dataBiases"]
    rejected = palpate.Dataset(built).rejections()
    assert stated["dataCollectionMissingData"].startswith(f"{len(rejected)} objects could not be used")
    assert f"palpate {palpate.__version__}" in stated["machineAnnotationTools"]


def test_croissant_ends_no_script_element_of_a_page(run, tmp_path):
    hostile = "</script><script>alert(1)</script>"
    export(palpate.Dataset(run), tmp_path / "out", arrays=["success"], source=hostile)
    text = (tmp_path / "out/croissant.json").read_text()
    assert "<" not in text and hostile in json.loads(text)["description"]
