"""Views through the Snakefile."""

import numpy as np

from palpate.store import open as open_store
from tests.workflow.conftest import VIEWS


def test_views_need_meshes_only_and_depend_on_no_other_object(extended, one_by_one, make_workflow):
    planned = make_workflow(views=VIEWS).planned("views/batch-0000.zarr")
    assert planned == {"catalogue_batch", "catalogue", "meshes", "views"}
    store = open_store(extended.run / "views/batch-0000.zarr")
    assert store["object"].tolist() == ["brick-millimetres", "can-nested-flat", "can-tall"]
    assert store["image"].shape == (3, 3, 48, 48, 3) and store["camera"].shape == (3, 3, 3, 4)
    assert store["mask"].any(axis=(2, 3)).all()
    assert (store["image"][:, :, 0, 0] == 255).all()
    other = open_store(one_by_one.run / "views/batch-0000.zarr")
    assert other["object"].tolist() == ["can-nested-flat"]
    np.testing.assert_array_equal(other["image"][0], store["image"][1, :2])
