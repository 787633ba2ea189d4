"""The look-up of shapes by silhouettes, against a naive search and distances in closed form."""

import numpy as np
import pytest

from palpate.mesh import OBJECT_POSITION
from palpate.protocol import CHAMFER_SCALE
from studies.benchmarks.lookup import PIXELS, Shape, chamfer, evaluate, everything, lookup, shape


def made(name: str, silhouette: np.ndarray, split: str = "train") -> Shape:
    return Shape(name, name.split("-")[0], "any", split, None, silhouette.astype(np.float32), 0.0)


def test_the_training_object_with_the_highest_overlap_is_found():
    rng = np.random.default_rng(0)
    shapes = [made(f"knife-{k}", rng.uniform(size=40) < rng.uniform(0.3, 0.7)) for k in range(12)]
    best, iou = lookup(shapes[:5], shapes)
    for one, found, value in zip(shapes[:5], best, iou, strict=True):
        a = one.silhouette > 0
        overlaps = {
            k: (a & (other.silhouette > 0)).sum() / (a | (other.silhouette > 0)).sum()
            for k, other in enumerate(shapes)
            if other is not one
        }
        assert value == pytest.approx(max(overlaps.values())) and overlaps[found] == max(overlaps.values())


def test_distance_of_two_shifted_clouds():
    cloud = np.stack(np.meshgrid(*[np.arange(4.0)] * 3), axis=-1).reshape(-1, 3)
    assert chamfer(cloud, cloud) == 0
    assert chamfer(cloud, cloud + [0.1, 0, 0]) == pytest.approx(CHAMFER_SCALE * 2 * 0.01)


def test_an_object_is_scaled_placed_and_seen():
    found = shape("bottle", 0, 0)
    assert np.linalg.norm(found.mesh.extents) == pytest.approx(0.5)
    assert np.allclose(found.mesh.bounds.mean(axis=0), OBJECT_POSITION)
    rows = np.flatnonzero(found.silhouette.reshape(PIXELS, PIXELS).any(axis=1))
    # A bottle of half a metre from a metre and a half fills about half of the image, around its middle.
    assert 0.3 * PIXELS < len(rows) < 0.7 * PIXELS and rows[0] < PIXELS / 2 < rows[-1]


def test_rows_hold_one_object_of_the_split_each():
    made = everything({"knife": 12})
    rows = evaluate(made, "train", 300)
    assert rows["object"].tolist() == [each.name for each in made if each.split == "train"]
    assert (rows["object"] != rows["looked up"]).all() and (rows["chamfer"] > 0).all()


def test_the_harder_split_turns_objects_and_holds_styles_out():
    plain, hard = everything({"knife": 12}), everything({"knife": 12}, harder=True)
    rest = {each.style for each in hard if each.split != "train"}
    assert rest and rest.isdisjoint(each.style for each in hard if each.split == "train")
    # A knife lies along y, so that most turns make it wider along x; its height stays in proportion.
    assert np.median([each.mesh.extents[0] for each in hard]) > 3 * np.median([each.mesh.extents[0] for each in plain])
    for one, turned in zip(plain, hard, strict=True):
        assert turned.mesh.volume / np.ptp(turned.mesh.vertices[:, 2]) ** 3 == pytest.approx(
            one.mesh.volume / np.ptp(one.mesh.vertices[:, 2]) ** 3
        )
