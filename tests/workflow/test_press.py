"""Presses through the Snakefile."""

import numpy as np
import pandas as pd

import palpate
from palpate import mesh
from palpate.batch import generator
from palpate.sensor import DIGIT
from palpate.touch import press_object
from tests.workflow.conftest import PRESSES


def test_presses_need_surfaces_only_and_depend_on_no_other_object(extended, make_workflow):
    planned = make_workflow(press=PRESSES).planned("press/batch-0000.zarr")
    assert planned == {"catalogue_batch", "catalogue", "meshes", "surface", "press"}
    dataset = palpate.Dataset(extended.run, stages=["press"])
    assert dataset.objects == ["brick-millimetres", "can-nested-flat", "can-tall"]
    for record in dataset:  # as the library presses it, by itself
        geometry, points = mesh.load_geometry(record.mesh), record.points - mesh.OBJECT_POSITION
        expected, _ = press_object(geometry, points, DIGIT, generator(0, record.name, "press"), **PRESSES)
        for press in record.presses:
            for name in ("reading", "pressure", "depth", "approach", "slide", "rotation"):
                np.testing.assert_array_equal(getattr(press, name), expected[name][press.number], err_msg=name)
            np.testing.assert_array_equal(press.position, expected["position"][press.number] + mesh.OBJECT_POSITION)
    table = pd.read_csv(extended.run / "tables/presses.csv").set_index(["class", "force"])
    assert table.loc[("total", 3), "presses"] == 6 and table.loc[("can", 1), "objects"] == 2
    assert (table.loc["total"].loc[3, ["area", "depth"]] > table.loc["total"].loc[1, ["area", "depth"]]).all()


def test_a_run_has_no_presses_unless_it_asks_for_them(make_workflow):
    workflow = make_workflow()
    assert "press" not in workflow.planned("dataset")
    refused = workflow("press/batch-0000.zarr", "--dry-run")
    assert refused.returncode != 0 and "set press.count" in refused.stdout + refused.stderr
    unable = workflow.changed(press=PRESSES, touch={"sensor": "dome360"})("dataset", "--dry-run")
    assert unable.returncode != 0 and "can't be pressed" in unable.stdout + unable.stderr
