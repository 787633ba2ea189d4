"""Views through the Snakefile."""

import numpy as np

from palpate.store import open as open_store

SETTINGS = {"count": 3, "size": 48, "samples": 1}


def test_views_need_meshes_only(make_workflow):
    workflow = make_workflow(views=SETTINGS)
    assert workflow.planned("views/batch-0000.zarr") == {"catalogue_batch", "catalogue", "meshes", "views"}
    result = workflow("views/batch-0000.zarr")
    assert result.returncode == 0, result.stderr
    store = open_store(workflow.run / "views/batch-0000.zarr")
    assert store["object"].tolist() == ["brick-millimetres", "can-nested-flat", "can-tall"]
    assert store["image"].shape == (3, 3, 48, 48, 3) and store["camera"].shape == (3, 3, 3, 4)
    assert store["mask"].any(axis=(2, 3)).all()
    assert (store["image"][:, :, 0, 0] == 255).all()
    alone = workflow.changed(views=SETTINGS | {"count": 2}, batch_size=1, run="alone")
    assert alone("views/batch-0002.zarr", "--quiet").returncode == 0
    other = open_store(workflow.run.with_name("alone") / "views/batch-0002.zarr")
    assert other["object"].tolist() == ["can-nested-flat"]
    np.testing.assert_array_equal(other["image"][0], store["image"][1, :2])
