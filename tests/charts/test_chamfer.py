"""Nearest neighbours and Chamfer distances against all pairs, forward and backward."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.charts import build_tree, chamfer_distance, nearest, one_sided_distance
from palpate.charts.chamfer import nearest_in_blocks

SIZES = st.integers(1, 70)


def all_pairs(a, b):
    """Squared distances (n, m), differentiable."""
    return (a[:, None] - b[None]).square().sum(dim=2)


def naive_one_sided(a, b):
    return torch.stack([all_pairs(p, q).min(dim=1).values.mean() for p, q in zip(a, b, strict=True)])


def naive_chamfer(a, b):
    return naive_one_sided(a, b) + naive_one_sided(b, a)


def cloud(n, seed=0, dtype=torch.float64):
    random = np.random.default_rng(seed)
    return torch.from_numpy(random.normal(size=(n, 3)) * 0.1 + [0, 0, 0.6]).to(dtype)


@settings(max_examples=40, deadline=None)
@given(
    n=SIZES,
    m=SIZES,
    seed=st.integers(0, 999),
    pairs=st.sampled_from([1, 7, 100, 10**6]),
    single=st.booleans(),
)
def test_nearest_is_the_nearest(n, m, seed, pairs, single):
    dtype = torch.float32 if single else torch.float64
    query, points = cloud(n, seed, dtype), cloud(m, seed + 1000, dtype)
    expected = all_pairs(query, points).argmin(dim=1)
    for found in (
        nearest(query, points),
        nearest(query, points, build_tree(points)),
        nearest_in_blocks(query, points, pairs),
    ):
        assert found.dtype == torch.int64
        if single:  # ties of rounding may go to either point
            distance = (query - points[found]).norm(dim=1)
            torch.testing.assert_close(distance, (query - points[expected]).norm(dim=1))
        else:
            assert torch.equal(found, expected)


@pytest.mark.parametrize(("dtype", "step"), [(torch.float32, 1e-5), (torch.float64, 1e-12)])
def test_the_nearest_of_points_that_are_close_together_and_far_from_the_origin(dtype, step):
    """Squares of coordinates, or single precision on the way, would round the differences off."""
    points = 0.6 + step * torch.arange(64, dtype=torch.float64)[torch.randperm(64, generator=torch.manual_seed(0))]
    points = torch.stack([points, points, points], dim=1).to(dtype)
    order = torch.randperm(64, generator=torch.manual_seed(1))
    for found in (nearest(points[order], points), nearest_in_blocks(points[order], points, 100)):
        assert torch.equal(found, order)


def test_coincident_points_and_grids():
    line = torch.linspace(-0.5, 0.5, 9)
    grid = torch.cartesian_prod(line, line, line)
    doubled = torch.cat([grid, grid])
    for found in (nearest(grid, doubled), nearest_in_blocks(grid, doubled, 1000)):
        assert torch.equal(doubled[found], grid)
    same = torch.full((300, 3), 0.25)
    assert ((nearest(grid, same) >= 0) & (nearest(grid, same) < 300)).all()
    assert chamfer_distance(grid[None], grid[None]).item() == 0


@settings(max_examples=25, deadline=None)
@given(sizes=st.lists(st.tuples(SIZES, SIZES), min_size=1, max_size=4), threads=st.sampled_from([1, 2]))
def test_clouds_of_unequal_size_forward_and_backward(sizes, threads):
    a = [cloud(n, 2 * i).requires_grad_() for i, (n, _) in enumerate(sizes)]
    b = [cloud(m, 2 * i + 1).requires_grad_() for i, (_, m) in enumerate(sizes)]
    weight = torch.linspace(1, 2, len(sizes), dtype=torch.float64)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        pairs = [
            (chamfer_distance(a, b), naive_chamfer(a, b)),
            (one_sided_distance(a, b), naive_one_sided(a, b)),
        ]
    finally:
        torch.set_num_threads(before)
    for distance, expected in pairs:
        assert distance.shape == (len(sizes),)
        torch.testing.assert_close(distance, expected)
        gradients = torch.autograd.grad((distance * weight).sum(), [*a, *b], allow_unused=True)
        naive = torch.autograd.grad((expected * weight).sum(), [*a, *b])
        for found, other in zip(gradients, naive, strict=True):
            torch.testing.assert_close(found, other)


def test_batches_of_tensors_and_trees_built_before():
    a, b = (torch.stack([cloud(n, seed) for seed in seeds]) for n, seeds in ((37, (1, 2)), (53, (3, 4))))
    trees = [build_tree(points) for points in b]
    expected = naive_chamfer(a, b)
    torch.testing.assert_close(chamfer_distance(a, b), expected)
    torch.testing.assert_close(chamfer_distance(a, b, b_trees=trees), expected)
    torch.testing.assert_close(chamfer_distance(b, a, a_trees=trees), expected)
    torch.testing.assert_close(one_sided_distance(a, b, trees), naive_one_sided(a, b))


def test_trees_are_used_in_their_order():
    a, b = [cloud(20, 1), cloud(30, 2)], [cloud(25, 3), cloud(25, 4)]
    swapped = [build_tree(points) for points in reversed(b)]
    assert not torch.allclose(one_sided_distance(a, b, swapped), one_sided_distance(a, b))


def test_gradcheck():
    a, b = (torch.stack([cloud(n, s) for s in (5, 6)]).requires_grad_() for n in (7, 11))
    assert torch.autograd.gradcheck(chamfer_distance, (a, b))
    assert torch.autograd.gradcheck(one_sided_distance, (a, b))


def test_two_single_points():
    a, b = torch.tensor([[[0.0, 0, 0]]]), torch.tensor([[[3.0, 0, 4]]])
    assert chamfer_distance(a, b).item() == 50
    assert one_sided_distance(a, b).item() == 25


def test_parallel_squares():
    line = torch.linspace(0, 1, 20, dtype=torch.float64)
    square = torch.cartesian_prod(line, line, torch.zeros(1, dtype=torch.float64))
    above = square + torch.tensor([0, 0, 0.01])
    torch.testing.assert_close(chamfer_distance([square], [above]), torch.tensor([2e-4], dtype=torch.float64))


@pytest.mark.parametrize("search", [nearest, one_sided_distance, chamfer_distance])
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (torch.zeros(0, 3), "empty point cloud"),
        (torch.tensor([[0, 0, 0], [0, torch.nan, 0]]), "NaN or infinity"),
        (torch.tensor([[0, 0, torch.inf]]), "NaN or infinity"),
        (torch.zeros(4, 2), r"must be \(n, 3\)"),
    ],
)
def test_bad_clouds_raise(search, first, bad, message):
    good = torch.zeros(5, 3)
    pair = (bad, good) if first else (good, bad)
    with pytest.raises(ValueError, match=message):
        search(*pair) if search is nearest else search(*([points] for points in pair))


def test_numbers_of_clouds_must_agree():
    one, two = torch.zeros(1, 5, 3), torch.zeros(2, 5, 3)
    for search in (chamfer_distance, one_sided_distance):
        with pytest.raises(ValueError, match="1 clouds against 2"):
            search(one, two)
        with pytest.raises(ValueError, match="at least one"):
            search([], [])


@pytest.mark.parametrize("first", [torch.float16, torch.float32])
def test_squares_of_short_distances_in_half_precision_are_not_zero(first):
    """Of 0.1 mm the square is 1e-8; the smallest number of float16 is 6e-8."""
    query, points = torch.tensor([[1e-4, 0, 0]], dtype=first), torch.zeros(1, 3, dtype=torch.float16)
    expected = query.double().square().sum().float()
    for distance in (one_sided_distance([query], [points]), one_sided_distance([points], [query])):
        assert distance.dtype == torch.float32
        torch.testing.assert_close(distance[0], expected, rtol=1e-5, atol=0)
