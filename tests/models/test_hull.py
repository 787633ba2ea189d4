"""The visual hull against rays that trimesh casts, and what models leave out of their meshes."""

import numpy as np
import pytest
import torch
import trimesh

from palpate.architectures import Architecture
from palpate.charts import sample_faces, sphere
from palpate.experiments import Experiment
from palpate.mesh import OBJECT_POSITION
from palpate.models import Reconstruction
from palpate.models.hull import inside, outside
from palpate.models.retrieval import Objects, Retrieval
from palpate.vision import paper_camera
from tests.models.batches import SMALL, random_batch
from tests.models.test_templates import templates

SIZE = 64
CENTRE = np.array(OBJECT_POSITION)


def table():
    """A top on two boards, with a gap between them that the camera sees through."""
    boxes = {(0.4, 0.3, 0.03): (0, 0, 0.12), (0.4, 0.02, 0.24): (0, -0.12, 0), (0.4, 0.021, 0.24): (0, 0.12, 0)}
    return trimesh.util.concatenate(
        [
            trimesh.creation.box(size, trimesh.transformations.translation_matrix(CENTRE + at))
            for size, at in boxes.items()
        ]
    )


def hits(mesh, camera):
    """(p, p) bool, the pixels whose middle's ray meets a mesh."""
    matrix = camera.matrix()
    rows, columns = np.indices((SIZE, SIZE)).reshape(2, -1) + 0.5
    rays = np.linalg.solve(matrix[:, :3], np.stack([columns, rows, np.ones(SIZE**2)]))
    eye = -np.linalg.solve(matrix[:, :3], matrix[:, 3])
    return mesh.ray.intersects_any(np.tile(eye, (SIZE**2, 1)), rays.T).reshape(SIZE, SIZE)


def seen(mask, camera, **more):
    matrix = torch.from_numpy(camera.matrix())
    return {"mask": torch.from_numpy(mask)[None], "camera": matrix[None].float()} | more


def test_an_object_is_inside_its_hull_and_what_shows_the_background_is_not():
    mesh, camera = table(), paper_camera(SIZE)
    mask = hits(mesh, camera)
    batch = seen(mask, camera)
    own = torch.from_numpy(mesh.sample(5000, seed=0))
    assert not outside(own, batch, 0).any()
    places = torch.from_numpy(CENTRE + np.random.default_rng(0).uniform(-0.3, 0.3, (5000, 3)))
    found, matrix = outside(places, batch, 0).numpy(), camera.matrix()
    for place, empty in zip(places.numpy(), found, strict=True):
        column, row, depth = matrix @ [*place, 1]
        row, column = int(row // depth), int(column // depth)
        shown = 0 <= row < SIZE and 0 <= column < SIZE
        around = mask[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        assert empty == (shown and not around.any())
    assert 0.2 < found.mean() < 0.9


def test_behind_the_hand_and_outside_the_image_may_be_anything():
    camera = paper_camera(SIZE)
    hand = torch.zeros(1, SIZE, SIZE, dtype=torch.bool)
    hand[:, SIZE // 2 :] = True
    batch = seen(np.zeros((SIZE, SIZE), bool), camera, hand=hand)
    places = torch.from_numpy(CENTRE + np.random.default_rng(0).uniform(-0.3, 0.3, (2000, 3)))
    projected = camera.matrix() @ np.c_[places, np.ones(2000)].T
    column, row = projected[:2] / projected[2]
    found = outside(places, batch, 0).numpy()
    above = (row >= 0) & (row < SIZE // 2 - 1) & (column >= 0) & (column < SIZE)
    assert found[above].all() and above.any() and not above.all()
    assert not found[row >= SIZE // 2].any() and not found[(column < 0) | (column >= SIZE)].any()


def test_a_shape_is_inside_by_all_its_corners_and_its_centre():
    mask = np.zeros((SIZE, SIZE), bool)
    camera = paper_camera(SIZE)
    eye = -np.linalg.solve(camera.matrix()[:, :3], camera.matrix()[:, 3])

    def at(row, column):
        ray = np.linalg.solve(camera.matrix()[:, :3], [column + 0.5, row + 0.5, 1])
        return torch.from_numpy(eye + ray * 0.7)

    mask[10:20, 10:50] = mask[30:50, 10:50] = True  # with a gap between
    within, across = [at(12, 12), at(12, 40), at(18, 20)], [at(18, 12), at(18, 40), at(33, 26)]
    beside = [at(12, 12), at(12, 40), at(12, 55)]
    assert inside(torch.stack([*map(torch.stack, (within, across, beside))]), seen(mask, camera), 0).tolist() == [
        True, False, False,
    ]  # fmt: skip
    # Were nothing left, the silhouette is of something else.
    assert inside(torch.stack(beside)[None], seen(mask, camera), 0).tolist() == [True]


def test_where_no_vision_chart_is_inside_all_stay_whatever_was_touched():
    """A touch that projects onto the silhouette does not make a shape of what is beside it."""
    torch.manual_seed(0)
    model = Reconstruction(
        Experiment("model", "template", "unoccluded", True, 1), Architecture.from_row(SMALL), templates=templates()[0]
    ).eval()
    batch = random_batch(1, 1, dtype=torch.float32)
    side = batch["image"].shape[-1]
    batch |= {"mask": torch.zeros(1, side, side, dtype=torch.bool), "camera_number": torch.zeros(1, dtype=torch.int64)}
    matrix = batch["camera"][0].double()
    row = column = 2  # a corner that the vision charts do not reach
    eye = -torch.linalg.solve(matrix[:, :3], matrix[:, 3])
    ray = torch.linalg.solve(matrix[:, :3], torch.tensor([column + 0.5, row + 0.5, 1.0]).double())
    batch["mask"][0, row, column] = True
    batch["success"][:] = True
    batch["charts"][:] = (eye + 0.9 * ray).float()
    batch["start"] = model.start[:, None].float()
    for network in (model.gcn, model.sphere_gcn):
        for parameter in network.layers[-1].parameters():
            torch.nn.init.zeros_(parameter)
    with torch.inference_mode():
        ((vertices, faces),) = model.meshes(batch)
        points = model.sample(model(batch), batch, 100, torch.Generator().manual_seed(0))
    assert torch.equal(points, sample_faces(vertices[None], faces, 100, torch.Generator().manual_seed(0)))
    assert outside(vertices[:1824], batch, 0).all() and not outside(vertices[1824:], batch, 0).any()
    assert len(faces) == 2304 + 4 * 128


@pytest.mark.parametrize("vision", ["unoccluded", "occluded"])
def test_a_model_leaves_out_the_faces_beside_the_silhouette_but_no_touch(vision):
    torch.manual_seed(0)
    experiment = Experiment("model", "template", vision, True, 1)
    model = Reconstruction(experiment, Architecture.from_row(SMALL), templates=templates()[0]).eval()
    batch = random_batch(2, 1, dtype=torch.float32)
    side = batch["image"].shape[-1]
    mask = torch.zeros(2, side, side, dtype=torch.bool)
    mask[:, side // 3 : side // 2, side // 3 : side // 2] = True
    batch |= {"mask": mask, "camera_number": torch.zeros(2, dtype=torch.int64)}
    batch |= {"hand": mask.roll(side // 4, 2)} if vision == "occluded" else {}
    with torch.inference_mode():
        predicted, meshes = model(batch), model.meshes(batch)
    for sample, (vertices, faces) in enumerate(meshes):
        torch.testing.assert_close(vertices, predicted[sample], rtol=0, atol=0)
        shown = {tuple(face) for face in faces.tolist()}
        expected = set()
        for face in model.faces.tolist():
            places = vertices[face]
            empty = outside(torch.cat([places, places.mean(dim=0, keepdim=True)]), batch, sample)
            if min(face) >= 1824 or not empty.any():
                expected.add(tuple(face))
        assert shown == expected
        assert 0 < len(shown) - 4 * 128 < 2304 and sum(min(face) >= 1824 for face in shown) == 4 * 128


def test_the_look_up_leaves_out_the_points_beside_the_silhouette():
    mesh, camera = table(), paper_camera(SIZE)
    mask = hits(mesh, camera)
    ball = sphere()[0][None]
    objects = Objects(ball, torch.ones(1, 1, SIZE, SIZE, dtype=torch.bool))
    batch = seen(mask, camera, camera_number=torch.zeros(1, dtype=torch.int64))
    ((cloud, faces),) = Retrieval(objects).meshes(batch)
    empty = outside(ball[0], batch, 0)
    assert 0 < empty.sum() < len(empty) and not len(faces)
    torch.testing.assert_close(cloud, ball[0, ~empty], rtol=0, atol=0)
