"""The signed distance that is decoded at points, and its surface, against closed forms."""

import numpy as np
import pytest
import torch
import trimesh

from palpate.architectures import Architecture
from palpate.experiments import Correction, Experiment
from palpate.mesh import OBJECT_POSITION
from palpate.models import implicit
from palpate.models.implicit import LEVEL, Implicit, corrected
from tests.models.batches import SMALL, random_batch, resized_world

ARCHITECTURE = {
    "encoder": SMALL["encoder"] | {"padding": 1, "norm": "instance"},
    "decoder": {"hidden": 12, "layers": 2},
}
CENTRE = torch.tensor(OBJECT_POSITION, dtype=torch.float64)


def built(touch=True, correction=None, **changed):
    torch.manual_seed(0)
    experiment = Experiment("x", "implicit", "unoccluded", touch, 1, correction=correction)
    model = Implicit(experiment, Architecture.from_row(ARCHITECTURE | changed), 4).double()
    if touch:
        torch.nn.init.normal_(model.touch_pooling.weight)
    return model


def around(samples=2, count=50):
    return CENTRE + 0.2 * torch.randn(samples, count, 3, dtype=torch.float64)


def surface(distance, model=None):
    """The mesh of a closed form (n,) m of places (n, 3) about the centre, by way of the model's grid."""
    model = model or built()
    grid = model._grid(lambda points: distance(points - CENTRE), CENTRE)
    vertices, faces = model.mesh(grid)
    return grid, trimesh.Trimesh(vertices.numpy() - OBJECT_POSITION, faces.numpy(), process=False)


def ball(radius, centre=(0.0, 0.0, 0.0)):
    return lambda places: (places - torch.tensor(centre, dtype=places.dtype)).norm(dim=1) - radius


def test_shapes_and_gradients():
    model, batch = built(), random_batch(2, 1)
    distances, odds = model.supervised(batch, around())
    assert distances.shape == (2, 50) and odds.shape == (2, 2, 64, 64)
    (distances.square().sum() + odds.square().sum()).backward()
    for name, weights in model.named_parameters():
        assert weights.grad is not None and weights.grad.abs().sum() > 0, name


def test_a_distance_depends_on_its_own_sample_and_point():
    model, batch, points = built(), random_batch(3, 1), around(3)
    together = model.supervised(batch, points)[0]
    alone = model.supervised({key: value[1:2] for key, value in batch.items()}, points[1:2, 7:9])[0]
    torch.testing.assert_close(alone[0], together[1, 7:9])
    assert (together[0] - model.supervised(batch, points[[1, 1, 1]])[0][0]).abs().max() > 1e-6


def test_a_sample_without_grasps_is_that_of_vision_alone():
    model, batch, points = built(), random_batch(2, 1), around()
    none = batch | {key: batch[key][:, :0] for key in ("success", "position", "rotation", "charts")}
    alone = built(touch=False)
    alone.load_state_dict({key: value for key, value in model.state_dict().items() if key[:6] != "touch_"})
    assert torch.equal(model.supervised(none, points)[0], alone.supervised(batch, points)[0])
    assert (model.supervised(batch, points)[0] != alone.supervised(batch, points)[0]).any()


def test_a_world_of_another_size_has_distances_of_that_size():
    model, batch, points = built(touch=False), random_batch(2, 1), around()
    large = built(touch=False, radius=3 * model.radius)
    resized = resized_world(batch, batch["camera"], 3.0)
    found = large.supervised(resized, 3 * (points - CENTRE) + CENTRE)[0]
    torch.testing.assert_close(found, 3 * model.supervised(batch, points)[0])


def test_the_surface_of_a_ball_in_closed_form():
    grid, mesh = surface(ball(0.15))
    radius = 0.15 + LEVEL
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=3e-3)  # positive: faces look outwards
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), radius, atol=1e-4)
    line = np.linspace(-0.26, 0.26, grid.shape[0])
    exact = np.linalg.norm(np.stack(np.meshgrid(line, line, line, indexing="ij")), axis=0) - 0.15
    near = np.abs(exact) < 0.008
    np.testing.assert_allclose(grid.numpy()[near], exact[near], atol=1e-12)
    assert (np.sign(grid.numpy()) == np.sign(exact)).all()


def test_a_blade_thinner_than_a_cell_has_no_hole():
    """6.4 mm thick, on a grid of 8.1 mm, half-way between two of its planes."""
    half, middle = torch.tensor([0.2, 0.03, 0.0032]), torch.tensor([0.0, 0.0, 0.26 / 64])

    def box(places):
        beyond = (places - middle).abs() - half
        return beyond.clamp(min=0).norm(dim=1) + beyond.amax(dim=1).clamp(max=0)

    mesh = surface(box)[1]
    assert mesh.is_watertight and mesh.body_count == 1 and mesh.euler_number == 2
    assert mesh.bounds[1, 0] - mesh.bounds[0, 0] == pytest.approx(0.4, abs=0.01)


def test_pieces_are_left_out_by_their_area():
    def pieces(places):
        small, large = ball(0.012, (0.2, 0.0, 0.0))(places), ball(0.04, (-0.2, 0.0, 0.0))(places)
        return torch.minimum(torch.minimum(small, large), ball(0.13)(places))

    mesh = surface(pieces)[1]
    assert mesh.body_count == 2 and mesh.bounds[0, 0] == pytest.approx(-0.24 - LEVEL, abs=1e-3)
    assert mesh.bounds[1, 0] == pytest.approx(0.13 + LEVEL, abs=1e-3)


@pytest.mark.parametrize("everywhere", [0.03, -0.03])
def test_where_all_is_outside_or_inside_there_is_still_a_closed_surface(everywhere):
    for slope in (0.0, 0.01):
        mesh = surface(lambda places, slope=slope: everywhere + slope * places[:, 0])[1]
        assert len(mesh.faces) and np.isfinite(mesh.vertices).all() and mesh.is_watertight


def test_a_correction_meets_the_touched_points():
    """A ball that is touched 5 mm outside of its surface and 5 mm inside of it: the mesh passes through both points."""
    touched = torch.tensor([[0.155, 0, 0], [0, 0.145, 0]], dtype=torch.float64)
    for noise, error in ((0.0, 1e-6), (0.05, 4e-4)):
        distance = corrected(ball(0.15), touched, Correction(0.02, noise))
        assert (distance(touched) - LEVEL).abs().max() < error
    far = torch.tensor([[0, 0, -0.15]], dtype=torch.float64)
    assert distance(far).abs().max() < 1e-4
    mesh = surface(distance)[1]
    along = trimesh.proximity.closest_point_naive(mesh, touched.numpy())[1]
    assert mesh.is_watertight and along.max() < 8e-4  # cells are 8 mm wide; less than the level


def test_a_grid_that_is_near_everywhere_is_refined_at_the_lowest_only():
    taken = []

    def distance(places):
        taken.append(len(places))
        return 1e-3 * places[:, 0]

    grid, mesh = surface(distance)
    assert sum(taken) < 17**3 + 33**3 + 2 * implicit.MOST + 1 and mesh.is_watertight


def test_without_a_touch_the_correction_changes_nothing(monkeypatch):
    monkeypatch.setattr(implicit, "DOUBLINGS", 1)
    batch = random_batch(2, 1)
    batch["success"][0] = False
    plain, bent = built()(batch), built(correction=Correction(0.08, 0.05))(batch)
    assert torch.equal(plain[0], bent[0]) and not torch.equal(plain[1], bent[1])
