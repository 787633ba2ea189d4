"""Every case that Blender can import, beside Blender's import of it: shapes and renders."""

import csv
import subprocess
import sys

import numpy as np
import pytest

from studies import readers
from tests.mesh.reading import CASES, CORNERS, SIDES

OTHER_SHAPE = {"dae-polygon-hole/frame.dae": "Blender fills the holes of COLLADA's polygons"}
REFUSED = {"gltf-draco-part/two_boxes.gltf": "Palpate does not decode Draco"}
NOT_IN_BLENDER = {
    "dae-unit-comma/block.dae": "it reads no decimal commas",
    "gltf-ktx2/plate.gltf": "it reads no KTX2",
}
# Mean differences of the renders in grey levels, over the object.
NOISE = 3
SMOOTH = 30  # of COLLADA without normals, which Blender shades smoothly
SHINY = 25  # of MTL, whose specular light Blender takes as well
OTHER_LOOK = {
    "coincident-two-materials/box.obj": "Blender draws coincident faces of two materials both",
    "dae-comma-colour/box.dae": "Blender reads no decimal commas: black",
    "dae-polygon-hole/frame.dae": "the shape is another",
    "gltf-transmission/glass.gltf": "Blender's glass refracts",
    "gltf-unlit/box.gltf": "Blender makes it shine",
    "obj-vertex-colour-bytes/box.obj": "Blender has no material for colours of vertices",
    "ply-diffuse/box.ply": "Blender has no material for colours of vertices",
}


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """By its path: the row of a case, as the command writes it."""
    out = tmp_path_factory.mktemp("readers") / "readers.csv"
    command = [sys.executable, "-m", readers.__name__, CASES, "--csv", out]
    run = subprocess.run(command, cwd=CASES.parents[1], capture_output=True, text=True)
    assert run.returncode == 1 and "1 of another shape" in run.stdout, run.stderr
    with open(out, newline="") as file:
        return {row["file"]: row for row in csv.DictReader(file)}


def test_the_cases_have_the_shapes_that_blender_reads(rows):
    assert {name for name, row in rows.items() if row["ours"] and not row["theirs"]} == set(REFUSED)
    assert {name for name, row in rows.items() if row["theirs"] and not row["ours"]} == set(NOT_IN_BLENDER)
    assert {name for name, row in rows.items() if float(row["shape"]) > readers.SHAPE} == set(OTHER_SHAPE)
    assert sum(not row["ours"] and not row["theirs"] for row in rows.values()) >= 35


def test_the_cases_look_as_blender_draws_them(rows):
    def bound(name):
        folder = CASES / name.split("/")[0]
        return SMOOTH if name.endswith(".dae") else SHINY if [*folder.rglob("*.mtl")] else NOISE

    other = {name for name, row in rows.items() if float(row["colour"]) > bound(name)}
    assert other == set(OTHER_LOOK)


def test_differences_of_shapes():
    """A box in closed form; a wall too much, a side too few, another proportion; doubled faces are none."""
    faces = np.array([(a, *pair) for a, b, c, d in SIDES for pair in ((b, c), (c, d))])
    box = readers.shape_of(7 * CORNERS + 3, faces)
    assert (box.area, box.volume) == pytest.approx((2, 3**-1.5)) and box.sides == pytest.approx([3**-0.5] * 3)
    wall = np.array([(0, 3, 7), (0, 7, 4)])
    others = [(CORNERS, np.concatenate([faces, wall])), (CORNERS, faces[2:]), (CORNERS * [1, 1, 1.01], faces)]
    for other in others:
        assert readers.difference(box, readers.shape_of(*other)) > readers.SHAPE
        assert readers.difference(box, readers.shape_of(*readers.repaired(*other))) > readers.SHAPE
    doubled = readers.repaired(CORNERS, np.concatenate([faces, faces[:3]]))
    assert readers.difference(box, readers.shape_of(*doubled)) < 1e-12
