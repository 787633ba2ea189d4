"""Views through the Snakefile: rendered, and Choy et al.'s own."""

import numpy as np
import trimesh
from PIL import Image

from palpate.mesh import DIAGONAL
from palpate.scene import Scene
from palpate.store import open as open_store
from palpate.vision import Renderer, views

SETTINGS = {"count": 3, "size": 48, "samples": 1, "published_renderings": None}


def test_views_need_meshes_only(make_workflow):
    workflow = make_workflow(views=SETTINGS)
    assert workflow.planned("views/batch-0000.zarr") == {"meshes", "views"}
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


def test_published_renderings_are_taken_instead(make_workflow, tmp_path):
    mesh = trimesh.creation.box((0.8, 0.3, 0.2))
    mesh.apply_scale(1 / np.linalg.norm(mesh.extents))  # ShapeNet's: y up
    for model in ("a1", "b2"):
        (tmp_path / f"models/02876657/{model}").mkdir(parents=True)
        mesh.export(tmp_path / f"models/02876657/{model}/model.obj")
    # What a camera about the turned mesh sees is what theirs saw.
    turned = mesh.copy().apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    (tmp_path / "turned").mkdir()
    turned.apply_scale(DIAGONAL).export(tmp_path / "turned/visual.glb")
    at = views.viewpoints(np.random.default_rng(5), 3)
    made = views.render(Renderer(samples=1, device="cpu"), Scene(tmp_path / "turned"), at, 48)
    folder = tmp_path / "renderings/02876657/a1/rendering"
    folder.mkdir(parents=True)
    (folder / views.METADATA).write_text("".join(f"{a} {e} 0 {d} 25\n" for a, e, _, d in at))
    for number, (image, mask) in enumerate(zip(made.image, made.mask, strict=True)):
        Image.fromarray(np.dstack([image, mask])).save(folder / f"{number:02d}.png")

    workflow = make_workflow(
        source={"kind": "shapenet", "path": str(tmp_path / "models")},
        classes=[{"class": "bottle", "objects": "all"}],
        views=SETTINGS | {"published_renderings": str(tmp_path / "renderings")},
    )
    result = workflow("views/batch-0000.zarr")
    assert result.returncode == 0, result.stderr
    store = open_store(workflow.run / "views/batch-0000.zarr")
    assert store["object"].tolist() == ["bottle-a1"]
    np.testing.assert_array_equal(store["mask"][0], made.mask)
    np.testing.assert_allclose(store["camera"][0], made.camera, atol=1e-4)
    rejected = (workflow.run / "rejected/views/batch-0000.csv").read_text()
    assert "bottle-b2,views," in rejected and "expected the published renderings" in rejected
