"""What every export has beside its samples."""

import csv
import fnmatch
import json
import os
import signal
import subprocess
import sys

import pytest

import palpate
from palpate import checksums
from palpate.interchange import export
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
    assert {line.split("  ", 1)[1] for line in lines} == files_of(exported) - {"SHA256SUMS"}
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


@pytest.mark.parametrize("damage", ["change", "remove"])
def test_a_mesh_that_is_not_the_one_that_was_written_is_an_error(run, tmp_path, damage):
    path = run / "meshes/batch-0000/block-0000/visual.glb"
    content = path.read_bytes()
    path.unlink()
    if damage == "change":
        path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(
        checksums.DamagedFile, match="block-0000/visual.glb (is missing|has changed .*); remove .*batch-0000"
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
    assert described["conformsTo"][0] == "http://mlcommons.org/croissant/1.0" and described["name"] == "small"
    nodes = {each["@id"]: each for each in described["distribution"]}
    for node in nodes.values():
        if node["@type"] == "cr:FileObject":
            size, digest = checksums.size_and_sha256(exported / node["contentUrl"])
            assert (node["contentSize"], node["sha256"]) == (f"{size} B", digest)
            continue
        assert node["name"] == "meshes" and len(fnmatch.filter(files_of(exported), node["includes"])) == 3
    ids = [*nodes, *(each["@id"] for each in described["recordSet"])]
    for records in described["recordSet"]:
        for field in records["field"]:
            ids.append(field["@id"])
            source = nodes[field["source"]["fileObject"]["@id"]]
            header = (exported / source["contentUrl"]).read_text().splitlines()[0].split(",")
            assert source["encodingFormat"] == "text/csv" and field["source"]["extract"]["column"] in header
    assert len(ids) == len(set(ids))
    assert {each["@id"] for each in described["recordSet"]} == {"objects", "grasps"}


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
