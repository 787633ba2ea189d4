"""The authors' dataset as a source, and a run exported to its layout, through the Snakefile."""

import pandas as pd
import pytest

import palpate
from tests.released.test_arrays import save, write_tree

SMALL = {
    "surface": {"points": 50},
    "grasps": {"per_object": 2, "attempts": 2},
    "vision": {"size": 40, "samples": 1, "device": "cpu"},
    "batch_size": 2,
}


@pytest.fixture(scope="module")
def workflow(make_workflow, tmp_path_factory):
    tree = write_tree(tmp_path_factory.mktemp("released"))
    save(tree / "scene_info/0001/00012/1.npy", {"touch_success": [True] * 4})  # the others are missing
    return make_workflow(source={"kind": "released", "path": str(tree)}, **SMALL)


def test_it_is_read_and_not_simulated(workflow):
    targets = "dataset", "tables/dataset_statistics.csv"
    assert workflow.planned(*targets) == {"dataset", "catalogue_batch", "catalogue", "released", "rejected", "table"}
    result = workflow(*targets)
    assert result.returncode == 0, result.stderr
    dataset = palpate.Dataset(workflow.run)
    assert {record.name: record.split for record in dataset} == {"0001-00013": "train", "0002-a.b": "test"}
    assert dataset.stages == ["surface", "touch", "vision"]
    rejected = pd.read_csv(workflow.run / "rejected.csv")
    assert rejected["object"].tolist() == ["0001-00012"]
    assert "1.npy: no cam_pos" in rejected["reason"][0]
    record = dataset["0002-a.b"]
    assert record.points.shape == (50, 3) and record.unoccluded.shape == (40, 40, 3)
    assert [grasp.success.tolist() for grasp in record.grasps] == [[True, True, False, True]] * 2
    statistics = pd.read_csv(workflow.run / "tables/dataset_statistics.csv", dtype={"class": str})
    assert statistics.set_index("class").loc["total", ["objects", "rejected"]].tolist() == [2, 1]
    assert not (workflow.run / "figures/data_point.png").exists()
    assert "readings lie on" in (workflow.run / "logs/released/batch-0001.log").read_text()


def test_models_need_no_simulation_of_it(workflow):
    assert workflow.planned("models/charts_occluded_touch/seed-0/best.ckpt") <= {
        "catalogue_batch",
        "catalogue",
        "released",
        "touch_depth",
        "charts",
        "reconstruction",
    }


def test_what_is_no_released_dataset_is_one_message(make_workflow, tmp_path):
    result = make_workflow(source={"kind": "released", "path": str(tmp_path)})("dataset", "--dry-run")
    said = result.stdout + result.stderr
    assert result.returncode and "surfaces: no such folder: set source.path" in said
