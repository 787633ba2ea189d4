"""How far a look-up gets: `python -m studies.benchmarks.lookup [--objects 150 | --objects 487 416 493 335] [--harder]`.

Makes procedural objects and scales them as `palpate.mesh` does. The reconstruction of an object is the training object
of any class whose silhouette, seen by the paper's camera, has the highest intersection over union with its own. The
table has the Chamfer distance between exterior points of the two, in the unit of the paper's tables, and beside it that
to a training object of the same class drawn at random. Seconds are processor time to make an object. The harder split
is that of config/paper_hard.yaml.
"""

import argparse
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import trimesh
from scipy.spatial import cKDTree

from palpate import shapes
from palpate.batch import generator
from palpate.camera import paper_camera, rotation_about
from palpate.catalogue import PAPER_SPLIT, SPLITS, Source, scan, splits_of
from palpate.mesh import DIAGONAL, OBJECT_POSITION
from palpate.protocol import CHAMFER_SCALE
from palpate.surface import sample
from palpate.surface.embree import RayMesh

PIXELS = 128  # width of the silhouettes


class Shape(NamedTuple):
    """An object in the world frame: its mesh, and its silhouette (PIXELS^2,) as 0 and 1."""

    name: str
    class_name: str
    style: str
    split: str
    mesh: trimesh.Trimesh
    silhouette: np.ndarray
    seconds: float


def shape(class_name: str, index: int, seed: int, split: str = "", turn: float = 0.0) -> Shape:
    """An object of a bounding box of 0.5 m from corner to corner, and what the camera sees of it.

    turn: degrees about the vertical, before it is scaled.
    """
    start = time.process_time()
    scene = shapes.make(class_name, index, seed)
    seconds = time.process_time() - start
    mesh = scene.to_geometry()
    mesh.vertices = mesh.vertices @ rotation_about(2, np.radians(turn)).T
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(DIAGONAL / np.linalg.norm(mesh.extents))
    mesh.apply_translation(OBJECT_POSITION)
    camera, name = paper_camera(PIXELS), f"{class_name}-{index:04d}"
    rays = camera.rays().reshape(-1, 3)
    hit = RayMesh(mesh).first_face(np.broadcast_to(camera.position, rays.shape), rays) >= 0
    style = shapes.style(class_name, index, seed)
    return Shape(name, class_name, style, split, mesh, hit.astype(np.float32), seconds)


def everything(counts: Mapping[str, int], seed: int = 0, harder: bool = False) -> list[Shape]:
    """The objects of a run with so many of each class, in its splits."""
    entries = scan(Source("procedural", "", turned=harder, seed=seed), counts)
    splits = splits_of(entries, PAPER_SPLIT | {"held_out": "styles" if harder else "objects"}, seed)
    return [
        shape(each.class_name, int(each.object.rpartition("-")[2]), seed, splits[each.object], each.turn)
        for each in entries
    ]


def lookup(found: Sequence[Shape], train: Sequence[Shape]) -> tuple[np.ndarray, np.ndarray]:
    """Index of the training object with the most similar silhouette (never the object itself), and the IoU."""
    mine, others = np.stack([each.silhouette for each in found]), np.stack([each.silhouette for each in train])
    common = mine @ others.T
    iou = common / (mine.sum(axis=1)[:, None] + others.sum(axis=1) - common)
    iou[np.array([[a.name == b.name for b in train] for a in found])] = -1
    best = iou.argmax(axis=1)
    return best, iou[np.arange(len(found)), best]


def chamfer(a: np.ndarray, b: np.ndarray) -> float:
    """Mean squared distance from points (n, 3) to points (m, 3), plus that back, times CHAMFER_SCALE."""
    return CHAMFER_SCALE * ((cKDTree(b).query(a)[0] ** 2).mean() + (cKDTree(a).query(b)[0] ** 2).mean())


def evaluate(made: Sequence[Shape], split: str, count: int) -> pd.DataFrame:
    """A row for each object of a split: class, IoU, Chamfer distance to what is looked up and to any of its class."""
    train = [each for each in made if each.split == "train"]
    found = [each for each in made if each.split == split]
    points = {}

    def cloud(each: Shape) -> np.ndarray:
        if each.name not in points:
            points[each.name] = sample(each.mesh, count, generator(0, each.name, "surface"))
        return points[each.name]

    rows = []
    for each, best, iou in zip(found, *lookup(found, train), strict=True):
        alike = [other for other in train if other.class_name == each.class_name and other.name != each.name]
        drawn = alike[generator(0, each.name, "lookup").integers(len(alike))]
        row = {"object": each.name, "class": each.class_name, "style": each.style, "looked up": train[best].name}
        row |= {"iou": iou, "chamfer": chamfer(cloud(each), cloud(train[best]))}
        rows.append(row | {"any of its class": chamfer(cloud(each), cloud(drawn))})
    return pd.DataFrame(rows)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Means and medians by class, and over all objects."""
    table = {}
    for name, group in [*rows.groupby("class", sort=False), ("all", rows)]:
        distance = group["chamfer"]
        table[name] = {"objects": len(group), "mean": distance.mean(), "median": distance.median()}
        table[name] |= {"mean IoU": group["iou"].mean(), "random, mean": group["any of its class"].mean()}
    return pd.DataFrame(table).T


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--objects", type=int, nargs="+", default=[150], help="of each class: one number, or four")
    parser.add_argument("--classes", nargs="+", choices=shapes.CLASSES, default=shapes.CLASSES)
    parser.add_argument("--split", choices=SPLITS, default="test", help="whose objects are looked up")
    parser.add_argument("--points", type=int, default=10_000, help="of an object's exterior surface")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--harder", action="store_true", help="styles held out, and objects turned")
    parser.add_argument("--rows", help="CSV file that gets a row for each object")
    args = parser.parse_args()
    counts = args.objects * len(args.classes) if len(args.objects) == 1 else args.objects
    if len(counts) != len(args.classes):
        parser.error(f"--objects: expected one number or {len(args.classes)}, got {len(counts)}")
    made = everything(dict(zip(args.classes, counts, strict=True)), args.seed, args.harder)
    rows = evaluate(made, args.split, args.points)
    if args.rows:
        rows.to_csv(args.rows, index=False)
    table = summary(rows)
    spent = {name: np.mean([each.seconds for each in made if each.class_name == name]) for name in args.classes}
    table["s an object"] = pd.Series(spent | {"all": np.mean([each.seconds for each in made])})
    train = sum(each.split == "train" for each in made)
    print(f"{len(made)} objects, {train} of them to look up; split {args.split}, {args.points} points")
    print(table.round(3).to_string())


if __name__ == "__main__":
    main()
