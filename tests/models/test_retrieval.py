"""Retrieval against brute force, and where what fits best is known."""

import numpy as np
import pytest
import torch
from scipy.spatial.distance import cdist

from palpate.experiments import Correction
from palpate.models import retrieval
from palpate.models.kriging import displaced, touched_points
from palpate.models.retrieval import Objects, Retrieval

CORRECTION = Correction(0.08, 0.3)
OBJECTS, CAMERAS, SIZE = 30, 2, 24


def collection(seed=0, points=200):
    """Boxes of random sizes and places as clouds (T, n, 3), and discs as their masks (T, k, p, p)."""
    random = torch.Generator().manual_seed(seed)
    clouds = torch.rand(OBJECTS, points, 3, generator=random) - 0.5
    clouds = clouds * (0.05 + 0.2 * torch.rand(OBJECTS, 1, 3, generator=random))
    centre, radius = (torch.rand(OBJECTS, CAMERAS, n, 1, 1, generator=random) for n in (2, 1))
    rows, columns = torch.meshgrid(*[torch.linspace(0, 1, SIZE)] * 2, indexing="ij")
    away = (rows - centre[:, :, 0]).square() + (columns - centre[:, :, 1]).square()
    return clouds, away < (0.2 + 0.4 * radius[:, :, 0]).square()


def batch(samples=12, touches=4, seed=1):
    random = torch.Generator().manual_seed(seed)
    clouds, masks = collection(seed)
    charts = clouds[:samples, : 81 * touches].repeat(1, 2, 1)[:, : 81 * touches].unflatten(1, (touches, 81))
    hand = collection(seed + 1)[1][:samples, 0]
    return {
        "mask": masks[:samples, 0] & ~hand,
        "hand": hand,
        "camera_number": torch.arange(samples) % CAMERAS,
        "success": torch.rand(samples, touches, generator=random) < 0.6,
        "charts": charts,
    }


def by_brute_force(clouds, masks, given):
    """Fits (B, T), pixel by pixel and from all pairs of points."""
    fits = np.zeros((len(given["success" if "success" in given else "mask"]), len(clouds)))
    for sample, row in enumerate(fits):
        for index, cloud in enumerate(clouds):
            if "mask" in given:
                counts = ~given["hand"][sample].numpy()
                mask = given["mask"][sample].numpy() & counts
                other = masks[index, given["camera_number"][sample]].numpy() & counts
                row[index] += (mask & other).sum() / max((mask | other).sum(), 1)
            if "charts" in given and len(places := touched_points(given)[sample]):
                nearest = cdist(places.double(), cloud.double()).min(axis=1)
                row[index] -= 200 * np.minimum(nearest, 0.05).__pow__(2).mean()
    return fits


VISION, TOUCH = ("mask", "hand", "camera_number"), ("success", "charts")


@pytest.mark.parametrize("takes", [VISION, TOUCH, VISION + TOUCH])
@pytest.mark.parametrize("cells", [50, 5e4])
def test_retrieval_is_brute_force(takes, cells, monkeypatch):
    monkeypatch.setattr(retrieval, "CELLS", cells)
    clouds, masks = collection()
    given = {key: value for key, value in batch().items() if key in takes}
    objects = Objects(clouds, masks if "mask" in takes else None)
    fits = by_brute_force(clouds, masks, given)
    best = fits.argmax(axis=1)
    assert len(set(best)) > 3
    assert torch.equal(Retrieval(objects)(given), clouds[best])
    numbers, found = objects.best(given, 5)
    assert np.array_equal(numbers, np.argsort(-fits, axis=1, kind="stable")[:, :5])
    np.testing.assert_allclose(found, np.take_along_axis(fits, numbers.numpy(), 1), rtol=0, atol=1e-6)


def test_bounds_hold_also_outside_the_grid():
    clouds, _ = collection()
    objects = Objects(clouds)
    for spread in (0.1, 0.3, 1.0):
        places = np.random.default_rng(0).normal(0, spread, (20, 3))
        for place in places:
            exact = [objects.squares(index, place[None])[0] for index in range(OBJECTS)]
            assert (objects.least_squares(place[None])[:, 0] <= np.array(exact)).all()
            assert spread < 1 or np.allclose(exact, 0.05**2)


def test_an_object_retrieves_itself_from_what_is_seen_past_the_hand():
    clouds, masks = collection()
    hand = torch.zeros(OBJECTS, SIZE, SIZE, dtype=torch.bool)
    hand[:, :, : SIZE // 3] = True
    for camera in range(CAMERAS):
        given = {
            "mask": masks[:, camera] & ~hand,
            "hand": hand,
            "camera_number": torch.full((OBJECTS,), camera),
        }
        objects = Objects(clouds, masks)
        seen = given["mask"].flatten(1).any(dim=1)  # Some are behind the hand.
        assert torch.equal(objects.overlap(given).diagonal(), seen.float()) and seen.sum() > OBJECTS / 2
        differ = (given["mask"].flatten(1)[:, None] ^ (masks[:, camera] & ~hand).flatten(1)).any(dim=2)
        assert (objects.overlap(given)[differ] < 1).all()


def test_without_a_touch_vision_decides_and_nothing_is_corrected():
    clouds, masks = collection()
    given = batch()
    given["success"][:] = False
    given["charts"] = torch.full_like(given["charts"], torch.nan)
    both = Retrieval(Objects(clouds, masks), CORRECTION)(given)
    assert torch.equal(both, Retrieval(Objects(clouds, masks))({key: given[key] for key in VISION}))


def test_the_retrieved_object_is_corrected():
    objects = Objects(*collection())
    given = batch()
    plain, corrected = (Retrieval(objects, each)(given) for each in (None, CORRECTION))
    for before, after, touched in zip(plain, corrected, touched_points(given), strict=True):
        assert torch.equal(after, displaced(before, None, touched, CORRECTION))
        assert torch.equal(after, before) == (not len(touched))
