"""Templates against brute force, and what a model must do that begins with one."""

import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial import KDTree

from palpate.architectures import Architecture
from palpate.charts import sample_faces, sphere, vision_atlas
from palpate.charts.atlas import chart_faces
from palpate.experiments import Correction, Experiment
from palpate.models import Reconstruction
from palpate.models import templates as templates_module
from palpate.models.kriging import displaced, nearest_on_faces, touched_points
from palpate.models.templates import (
    BENT,
    MASK,
    NOISE,
    NUGGET,
    POINTS,
    SCALES,
    SILHOUETTE_NUGGET,
    Templates,
    best_scale,
    conditioned,
    kriged,
    shrunk,
    smoothed,
)
from tests.models.batches import CAMERAS, COUNT, LEAST_FIT, SIZE, SMALL, TEST_SCALES, random_batch, templates


def batch(samples=8, grasps=1, seed=1):
    """Touches on other ellipsoids, and silhouettes of others in part behind a hand."""
    others, masks = templates(seed=seed)
    found = random_batch(samples, grasps, seed, dtype=torch.float32)
    charts = found["charts"].shape[1:3]
    on_others = sample_faces(others.shapes[:samples], sphere()[1], charts.numel(), torch.Generator().manual_seed(0))
    hand = torch.zeros(samples, SIZE, SIZE, dtype=torch.bool)
    hand[:, SIZE // 2 :] = True
    return found | {
        "charts": on_others.unflatten(1, charts),
        "mask": masks[:samples, 0] & ~hand,
        "hand": hand,
        "camera_number": torch.arange(samples) % CAMERAS,
    }


def by_brute_force(model, masks, given, sample):
    """The fit (T,) of every template to a sample, and the covariance (1 + T, 1 + T) of their shapes, the sample first:
    by covered shares pixel by pixel, or by distances from all pairs of points."""
    if "mask" in given:
        camera = given["camera_number"][sample]
        seen, hand = (shrunk(given[key][sample][None])[0].double() / 255 for key in ("mask", "hand"))
        every = [seen, *(shrunk(each[None])[0].double() / 255 * (1 - hand) for each in masks[:, camera])]
        both = torch.tensor([[(one * other).sum() for other in every] for one in every])
        areas = torch.tensor([one.sum() for one in every])
        alike = both / (areas[:, None] + areas[None] - both)
        touched = "success" in given and given["success"][sample].any()
        return alike[0, 1:].numpy(), np.exp((1 if touched else 2) * (alike.numpy() - 1))
    clouds = sample_faces(model.shapes, sphere()[1], POINTS, torch.Generator().manual_seed(0)).double()
    points = touched_points(given)[sample].double()
    distances = [torch.cdist(points, cloud).min(dim=1).values.clamp(max=0.05) for cloud in clouds]
    distances = torch.stack([torch.zeros(len(points)).double(), *distances])
    apart = (distances[:, None] - distances[None]).square().mean(dim=2).numpy()
    return -200 * apart[0, 1:], np.exp(-100 * apart)


def weights_of(covariance, nugget=NUGGET):
    """The weights (n,) of ordinary kriging and its variance, by its equations with a Lagrange multiplier."""
    known, ones = covariance[1:, 1:] + nugget * np.eye(len(covariance) - 1), np.ones((len(covariance) - 1, 1))
    solved = np.linalg.solve(np.block([[known, ones], [ones.T, 0]]), np.append(covariance[0, 1:], 1))
    return solved[:-1], covariance[0, 0] + nugget - solved @ np.append(covariance[0, 1:], 1)


TOUCH, VISION = ("success", "charts"), ("mask", "hand", "camera_number")


@pytest.mark.parametrize("takes", [TOUCH, VISION, TOUCH + VISION])
@pytest.mark.parametrize("excluding", [False, True])
def test_the_start_is_interpolated_from_what_brute_force_finds(takes, excluding, monkeypatch):
    conditions = []  # their results are compared with its own: rounding can change which face is nearest
    monkeypatch.setattr(
        templates_module, "conditioned", lambda *of: conditions.append([*map(torch.clone, of)]) or conditioned(*of)
    )
    for name, count in (("NEIGHBOURS", 12), ("TOUCH_NEIGHBOURS", 7)):
        monkeypatch.setattr(templates_module, name, count)
    model, masks = templates("mask" in takes)
    given = {key: values for key, values in batch().items() if key in takes}
    if takes == TOUCH + VISION:
        given["success"][:2] = False  # without a touch an image has the other scale
    samples = len(next(iter(given.values())))
    fits, covariances = zip(*(by_brute_force(model, masks, given, sample) for sample in range(samples)), strict=True)
    assert len({each.argmax() for each in fits}) > 2
    if excluding:  # of every other sample the best is its own object
        given["excluded"] = torch.tensor([each.argmax() if row % 2 else -1 for row, each in enumerate(fits)])
    start = model(given)
    for row, (fit, covariance) in enumerate(zip(fits, covariances, strict=True)):
        order = [int(n) for n in np.argsort(-fit, kind="stable") if not excluding or n != given["excluded"][row]]
        order = order[: 12 if "mask" in takes else 7]
        both = [0, *(1 + number for number in order)]
        weights, _ = weights_of(covariance[np.ix_(both, both)], SILHOUETTE_NUGGET if "mask" in takes else NUGGET)
        found, *_, touched = conditions[row]
        expected = np.einsum("n,nvi->vi", weights, model.shapes[order].double().numpy())
        torch.testing.assert_close(found, torch.from_numpy(expected).float(), atol=2e-6, rtol=0)
        assert torch.equal(touched, touched_points(given)[row] if "charts" in given else torch.empty(0, 3))
        expected = displaced(conditioned(*conditions[row]), sphere()[1], touched, BENT)
        torch.testing.assert_close(start[:, row], expected[vision_atlas().position], atol=1e-6, rtol=0)


def test_kriging_by_its_equations():
    """Its moves have the covariance of the interpolated shape: its variance times what n shapes say of vertices'."""
    vertices, random = templates()[0].shapes[:10].double(), np.random.default_rng(0)
    places = random.random((11, 2))
    covariance = np.exp(-np.linalg.norm(places[:, None] - places[None], axis=2))
    shape, off, factor = kriged(vertices, torch.from_numpy(covariance))
    moves = torch.linalg.solve(factor, off.flatten(1))
    weights, variance = weights_of(covariance)
    flat, known = vertices.flatten(1).numpy(), covariance[1:, 1:] + NUGGET * np.eye(10)
    assert np.allclose(shape.flatten(), weights @ flat, atol=1e-12)
    trend = np.linalg.solve(known, np.ones(10))
    apart = flat - trend @ flat / trend.sum()
    expected = variance * apart.T @ np.linalg.inv(known) @ apart / 10
    assert np.allclose(moves.T @ moves, expected, atol=1e-10) and torch.equal(factor, factor.tril())


def test_without_a_nugget_an_object_is_found_again():
    vertices, places = templates()[0].shapes.double(), torch.from_numpy(np.random.default_rng(0).random((COUNT, 2)))
    known = torch.exp(-torch.cdist(places, places))
    numbers = [3, *range(COUNT)]
    shape, off, factor = kriged(vertices, known[numbers][:, numbers], nugget=1e-9)
    assert torch.allclose(shape, vertices[3], atol=1e-6)
    assert torch.linalg.solve(factor, off.flatten(1)).abs().max() < 1e-4


def test_the_scale_is_the_one_that_finds_left_out_shapes_best(monkeypatch):
    """By the equations of kriging, and distances of scipy between points of trimesh."""
    monkeypatch.setattr(templates_module, "NEIGHBOURS", 12)
    taken = []
    for seed in range(2):
        model = templates(seed=seed)[0]
        shapes, masks = model.shapes.double().numpy(), model.masks[:, 0].flatten(1).double().numpy() / 255
        both, areas = masks @ masks.T, masks.sum(axis=1)
        alike = both / (areas[:, None] + areas - both)
        clouds = [trimesh.sample.sample_surface(trimesh.Trimesh(each, sphere()[1]), 6000, seed=0)[0] for each in shapes]
        errors = dict.fromkeys(SCALES, 0.0)
        for number, cloud in enumerate(clouds):
            order = [other for other in np.argsort(-alike[number], kind="stable") if other != number][:12]
            rows = np.ix_([number, *order], [number, *order])
            for scale in SCALES:
                weights, _ = weights_of(np.exp(scale * (alike[rows] - 1)), SILHOUETTE_NUGGET)
                found = trimesh.Trimesh(np.einsum("n,nvi->vi", weights, shapes[order]), sphere()[1])
                points = trimesh.sample.sample_surface(found, 6000, seed=1)[0]
                for one, other in ((points, cloud), (cloud, points)):
                    errors[scale] += (KDTree(one).query(other)[0] ** 2).mean()
        taken.append(min(errors, key=errors.get))
        assert best_scale(model.shapes, model.masks[:, 0]) == taken[-1]
        assert Templates(model.shapes, model.masks).scales.tolist() == [taken[-1], SCALES[0]]
    assert {*taken} == {*SCALES}


def test_a_single_template_has_a_scale():
    model = templates()[0]
    assert best_scale(model.shapes[:1], model.masks[:1, 0]) == SCALES[0]


@pytest.mark.parametrize(("number", "rounds"), [(4, 1), (4, 3), (5, 3), (7, 3)])
def test_conditioning_solves_the_equations_of_a_gaussian_process(number, rounds, monkeypatch):
    """By the covariance of the points' distances, and trimesh's normals of vertices."""
    monkeypatch.setattr(templates_module, "ROUNDS", rounds)
    model, random = templates()[0], torch.Generator().manual_seed(0)
    start, faces, error = model.shapes[12].double(), sphere()[1], spread_of(model.shapes[:10].double())
    touched = sample_faces(model.shapes[number : number + 1].double(), faces, 30, random)[0]
    covariance = np.cov(model.shapes[:10].double().flatten(1).numpy(), rowvar=False, bias=True)
    expected = start.flatten().numpy()
    for _ in range(rounds):
        mesh = trimesh.Trimesh(expected.reshape(-1, 3), faces, process=False)
        corners, weights = (each.numpy() for each in nearest_on_faces(touched, torch.tensor(mesh.vertices), faces))
        around = trimesh.geometry.weighted_vertex_normals(
            len(mesh.vertices), mesh.faces, mesh.face_normals, np.repeat(mesh.area_faces[:, None], 3, axis=1)
        )
        normals = trimesh.unitize(np.einsum("mk,mki->mi", weights, around[corners]))
        rows = np.zeros((len(touched), len(mesh.vertices), 3))
        for row, point_corners, point_weights, normal in zip(rows, corners, weights, normals, strict=True):
            row[point_corners] = point_weights[:, None] * normal
        rows = rows.reshape(len(rows), -1)
        away = (touched.numpy() * normals).sum(axis=1) - rows @ start.flatten().numpy()
        of_distances = rows @ covariance @ rows.T + NOISE**2 * np.eye(len(rows))
        expected = start.flatten().numpy() + covariance @ rows.T @ np.linalg.solve(of_distances, away)
    found = conditioned(start, *error, touched)
    assert (found - start).norm(dim=1).max() > 0.01
    assert np.allclose(found.flatten(), expected, atol=1e-8)


@pytest.mark.parametrize("number", range(6))
def test_touches_that_differ_by_a_micrometre_move_a_shape_by_about_as_much(number):
    """Where they are on edges, too: the nearest face of these is any of several."""
    vertices, faces = templates()[0].shapes.double(), sphere()[1]
    corners = vertices[number, faces[::40]]
    touched = torch.cat([corners.mean(dim=1), corners[:, :2].mean(dim=1), corners[:, 0]])
    nudged = touched + 1e-6 * torch.randn(touched.shape, generator=torch.Generator().manual_seed(0))
    found, other = (conditioned(vertices[10], *spread_of(vertices), points) for points in (touched, nudged))
    assert (found - vertices[10]).norm(dim=1).max() > 0.005
    assert (found - other).norm(dim=1).max() < 1e-4


def spread_of(shapes):
    """Of shapes (n, V, 3) moves with their covariance, as `conditioned` takes them: times some factor, and it."""
    moves = (shapes - shapes.mean(dim=0)) / len(shapes) ** 0.5
    random = torch.rand(len(shapes), len(shapes), generator=torch.Generator().manual_seed(0))
    factor = torch.eye(len(shapes)).double() + random.double().tril()
    return torch.einsum("mn,nvi->mvi", factor, moves), factor


def test_a_shape_that_is_touched_all_over_is_found():
    """It is between those that the moves are of."""
    vertices = templates()[0].shapes.double()
    shape, start = vertices[:3].mean(dim=0), vertices[10]
    touched = sample_faces(shape[None], sphere()[1], 3000, torch.Generator().manual_seed(0))[0]
    found = conditioned(start, *spread_of(vertices), touched)
    assert (found - shape).norm(dim=1).mean() < 0.1 * (start - shape).norm(dim=1).mean()


def test_without_touches_a_shape_stays():
    vertices = templates()[0].shapes
    assert torch.equal(conditioned(vertices[0], vertices[1:3], torch.eye(2), torch.empty(0, 3)), vertices[0])


def test_an_object_is_its_own_template_unless_it_is_excluded():
    model, masks = templates()
    given = {"mask": shrunk(masks[:, 0]) / 255, "camera_number": torch.zeros(COUNT, dtype=torch.int64)}
    numbers, fits = model.objects.best(given, 3)
    assert torch.equal(numbers[:, 0], torch.arange(COUNT)) and (fits[:, 0] > fits[:, 1]).all()
    others, _ = model.objects.best(given | {"excluded": torch.arange(COUNT)}, 2)
    assert torch.equal(others, numbers[:, 1:])


@pytest.mark.parametrize("excluded", [-1, 0])
def test_of_a_single_template_every_start_is_made(excluded):
    model, masks = templates()
    only = Templates(model.shapes[:1], model.masks[:1], TEST_SCALES)
    given = {"mask": masks[:2, 0], "camera_number": torch.zeros(2, dtype=torch.int64)}
    start = only(given | {"excluded": torch.full((2,), excluded)})
    assert torch.equal(start, only.shapes[:, vision_atlas().position].transpose(0, 1).expand_as(start))


def test_masks_shrink_to_the_covered_share_of_a_pixel():
    mask = torch.zeros(2, 1, 4 * MASK, 4 * MASK, dtype=torch.bool)
    mask[1, 0, :2, :4], mask[1, 0, 4:8, 8:12] = True, True  # 8 and 16 of 16 pixels
    found = shrunk(mask)
    assert found.shape == (2, 1, MASK, MASK) and not found[0].any()
    assert found[1, 0, 0, 0] == 128 and found[1, 0, 1, 2] == 255 and found.count_nonzero() == 2


def test_charts_are_joined_at_their_mean_and_smoothed_as_trimesh_does_it():
    place, (vertices, faces) = vision_atlas().position, sphere()
    torn = vertices[place][:, None] + 0.005 * torch.randn(len(place), 2, 3, generator=torch.Generator().manual_seed(0))
    found = smoothed(torn)
    for sample in range(2):
        closed = [torn[place == number, sample].double().mean(dim=0) for number in range(len(vertices))]
        mesh = trimesh.Trimesh(torch.stack(closed), faces, process=False)
        trimesh.smoothing.filter_taubin(mesh, lamb=0.5, nu=1 / 1.9, iterations=2)
        expected = torch.from_numpy(np.array(mesh.vertices)).float()[place]
        torch.testing.assert_close(found[:, sample], expected, atol=1e-6, rtol=0)


def model_of(touch=True, vision="occluded", grasps=2, **more):
    torch.manual_seed(0)
    experiment = Experiment("model", "template", vision, touch, grasps, **more)
    found = templates(vision != "none")[0]
    return Reconstruction(experiment, Architecture.from_row(SMALL), templates=found).eval()


@pytest.mark.parametrize("vision", ["occluded", "none"])
def test_what_the_networks_move_is_the_start_or_a_sphere_where_no_template_fits_well(vision):
    model, given = model_of(vision=vision), batch(grasps=2)
    samples, masks = len(given["success"]), templates()[1]
    if vision == "none":
        given = {key: given[key] for key in ("success", "position", "rotation", "charts")}
    fits = [by_brute_force(model.templates, masks, given, sample)[0].max() for sample in range(samples)]
    if vision == "none":  # -200 times the mean square of the distances, m
        fits = [1 - (-fit / 200) ** 0.5 / 0.05 for fit in fits]
    known = torch.tensor(fits) >= LEAST_FIT
    torch.testing.assert_close(model.templates.fit(given), torch.tensor(fits, dtype=torch.float64), atol=1e-5, rtol=0)
    assert known.any() and not known.all() and min(abs(fit - LEAST_FIT) for fit in fits) > 1e-4
    networks = [model.gcn, model.sphere_gcn]
    for network in networks:
        for parameter in network.layers[-1].parameters():
            torch.nn.init.zeros_(parameter)
    with torch.no_grad():
        vertices = model(given)
        assert torch.equal(vertices, model(given))
        starts = [model.templates(given), model.start[:, None].float().expand(-1, samples, -1)]
        for start, trained in zip(starts, model.stages(given), strict=True):
            assert torch.equal(trained, start.transpose(0, 1))
        start = torch.where(known[..., None], *starts)
        closed = model(given, closed=True)
    count = len(start)
    assert torch.equal(vertices[:, :count], start.transpose(0, 1))
    assert torch.equal(closed[:, :count], smoothed(start).transpose(0, 1))
    assert torch.equal(vertices[:, count:], closed[:, count:])
    mesh = trimesh.Trimesh(closed[0, :count], chart_faces(0), process=True)
    assert mesh.is_watertight and len(mesh.vertices) == len(sphere()[0])
    copied = vertices[:, count:].unflatten(1, given["charts"].shape[1:3])
    assert torch.equal(copied[given["success"]], given["charts"][given["success"]])


def test_a_template_has_to_fit_as_well_as_samples_ask_for_that_are_touched_or_not():
    model, given = model_of(), batch(grasps=2)
    given["success"][1] = False
    touched = given["success"].any(dim=1)
    assert touched.any() and not touched.all()
    for least, known in (([0.0, 2.0], ~touched), ([2.0, 0.0], touched)):
        model.templates.least_fit.copy_(torch.tensor(least))
        assert torch.equal(model.templates.known(given), known)
        without = {key: values for key, values in given.items() if key in ("mask", "hand", "camera_number")}
        assert torch.equal(model.templates.known(without), torch.full_like(known, least[0] == 0))


def test_a_network_that_no_sample_wants_is_left_out_and_nothing_changes(monkeypatch):
    """Samples one by one, of which each wants one network, against all at once, which want both."""
    model, given = model_of(), batch(grasps=2)
    called, deform = [], model.deform
    monkeypatch.setattr(model, "deform", lambda *of: called.append(of[-1]) or deform(*of))
    with torch.no_grad():
        together, known = model(given), model.templates.known(given)
        assert called == [model.gcn, model.sphere_gcn] and known.any() and not known.all()
        for sample, is_known in enumerate(known):
            called.clear()
            alone = model({key: values[sample : sample + 1] for key, values in given.items()})
            assert called == [model.gcn if is_known else model.sphere_gcn]
            torch.testing.assert_close(alone[0], together[sample], atol=1e-5, rtol=0)


def test_without_a_touch_vision_chooses_the_start_and_nothing_is_corrected():
    model, given = model_of(correction=Correction(0.08, 0.3), fewer_grasps=True), batch()
    none = given | {key: given[key][:, :0] for key in ("success", "position", "rotation", "charts")}
    assert torch.equal(model.templates(none), model.templates({key: given[key] for key in VISION}))
    alone = model_of(touch=False)
    weights = {name: values for name, values in model.state_dict().items() if name in alone.state_dict()}
    alone.load_state_dict(weights)
    with torch.no_grad():
        assert torch.equal(model(none), alone(none))


def test_in_mixed_precision_the_start_is_the_same():
    model, given = templates()[0], batch()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        mixed = model(given)
    torch.testing.assert_close(mixed, model(given), atol=1e-7, rtol=0)


def test_templates_are_for_their_strategy():
    for strategy, given in (("charts", templates()[0]), ("template", None)):
        experiment = Experiment("a", strategy, "occluded", True, 1)
        with pytest.raises(ValueError, match="for strategy template"):
            Reconstruction(experiment, Architecture.from_row(SMALL), templates=given)


def test_a_batch_without_its_silhouette():
    given = batch(grasps=2)
    with pytest.raises(ValueError, match="the batch has no mask, hand"):
        model_of()({key: values for key, values in given.items() if key not in ("mask", "hand")})
