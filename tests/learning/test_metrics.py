import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.charts import build_tree
from palpate.learning.metrics import ring_distances, score, seeded
from palpate.protocol import pixel2mesh_chamfer


def clouds(seed: int, n: int, m: int):
    rng = np.random.default_rng(seed)
    return rng.normal(0, 0.01, (n, 3)), rng.normal(0, 0.01, (m, 3))


def naive(prediction, truth) -> tuple[float, float, float]:
    """All pairs, in double precision; F1 as the text of the supplement says, at the protocol's scale."""
    pairs = ((prediction[:, None] - truth[None]) ** 2).sum(axis=2)
    chamfer = 9000 * (pairs.min(axis=1).mean() + pairs.min(axis=0).mean())
    scores = []
    for tau in (1e-4, 2e-4):
        # Distances of meshes scaled by 0.57, where ShapeNet's diagonal is 1 and ours 0.5.
        scaled = np.sqrt(pairs) * 0.57 / 0.5
        precision = (scaled.min(axis=1) ** 2 < tau).mean()
        recall = (scaled.min(axis=0) ** 2 < tau).mean()
        scores.append(100 * 2 / (1 / precision + 1 / recall) if precision and recall else 0.0)
    return chamfer, *scores


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 40), m=st.integers(1, 40))
def test_scores_are_those_of_all_pairs(seed, n, m):
    prediction, truth = clouds(seed, n, m)
    found = score(torch.from_numpy(prediction), build_tree(torch.from_numpy(truth)))
    assert found == pytest.approx(naive(prediction, truth), rel=1e-9)


def test_float32_clouds_change_nothing():
    prediction, truth = (torch.from_numpy(cloud).float() for cloud in clouds(1, 200, 300))
    found = score(prediction, build_tree(truth))
    assert found == pytest.approx(naive(prediction.double().numpy(), truth.double().numpy()), rel=1e-6)


def test_f1_of_the_truth_is_100_and_of_nothing_near_0():
    cloud, _ = clouds(2, 50, 1)
    cloud = torch.from_numpy(cloud)
    tree = build_tree(cloud)
    assert score(cloud, tree) == (0.0, 100.0, 100.0)
    assert score(cloud + 1, tree)[1:] == (0.0, 0.0)


def test_the_thresholds_are_of_squared_distances_at_the_protocols_scale():
    """A shift by d scores 100 at tau exactly while (d x 0.57 / 0.5)^2 is below tau."""
    cloud = torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], dtype=torch.float64)
    limit = np.sqrt(1e-4) * 0.5 / 0.57

    def shifted(d):
        return score(cloud + torch.tensor([0, d, 0]), build_tree(cloud))

    assert shifted(0.999 * limit).f1_tau == 100 and shifted(1.001 * limit).f1_tau == 0
    wider = np.sqrt(2) * limit
    assert shifted(0.999 * wider).f1_2tau == 100 and shifted(1.001 * wider).f1_2tau == 0


def test_pixel2meshs_chamfer_distance_is_that_of_the_scaled_clouds():
    prediction, truth = clouds(3, 30, 40)
    scaled = naive(prediction * 0.57 / 0.5, truth * 0.57 / 0.5)[0] / 9000
    ours = score(torch.from_numpy(prediction), build_tree(torch.from_numpy(truth))).chamfer
    assert pixel2mesh_chamfer(ours) == pytest.approx(1000 * scaled)


def test_clouds_that_are_empty_or_not_finite_are_errors():
    good = torch.zeros(3, 3)
    bad = torch.tensor([[0.0, 0.0, float("nan")]])
    for wrong in (good[:0], bad):
        with pytest.raises(ValueError, match="empty|NaN"):
            score(wrong, build_tree(good))
        with pytest.raises(ValueError, match="empty|NaN"):
            ring_distances([good.numpy()], wrong)
    with pytest.raises(ValueError, match="NaN"):
        ring_distances([bad.numpy()], good)


def test_random_numbers_depend_on_the_names_only():
    first, again, other = (
        torch.rand(4, generator=seeded(0, name, "evaluation")) for name in ("bottle-1", "bottle-1", "bottle-2")
    )
    assert torch.equal(first, again) and not torch.equal(first, other)
