"""A run of one object, a beam that a hand gets round, made by the real functions: meshes, surface, grasps."""

from pathlib import Path

import numpy as np
import trimesh

from palpate import mesh, store, surface
from palpate.batch import generator
from palpate.grasp import grasp_object
from palpate.hand import allegro
from palpate.mesh import OBJECT_POSITION
from palpate.sensor import DIGIT
from studies.subjects import Subject

NAME, BATCH = "beam-0000", "batch-0000"
ATTRIBUTES = {"made_from": {}, "seed": 0, "sensor": DIGIT.description()}
SETTINGS = {"mesh": {"collision_faces": 200}, "grasps": {"timestep": 0.004}}


def beam() -> trimesh.Trimesh:
    """768 faces, wavy along its length."""
    solid = trimesh.creation.box((0.05, 0.04, 0.5)).subdivide().subdivide().subdivide()
    solid.vertices[:, 0] *= 1 + 0.2 * np.sin(40 * solid.vertices[:, 2])
    return solid


def build(run: Path) -> Subject:
    """Write the stores; returns the object."""
    folder = run / "meshes" / BATCH / NAME
    run.mkdir(parents=True, exist_ok=True)
    beam().export(run / "beam.ply")
    mesh.prepare(run / "beam.ply", folder, collision_faces=SETTINGS["mesh"]["collision_faces"])
    visual, collision = mesh.load_visual(folder), mesh.load_collision(folder)
    points = surface.sample(visual, 2000, generator(0, NAME, "surface")) + np.array(OBJECT_POSITION)
    found = grasp_object(visual, collision, points, allegro(), generator(0, NAME, "grasps"), per_object=2, attempts=2)
    hand = {f"hand/{key}": array for key, array in allegro().to_arrays().items()}
    arrays = {
        "surface": store.join("surface", {NAME: {"points": points}}),
        "grasps": store.join("grasps", {NAME: vars(found)}) | hand,
    }
    for stage, stored in arrays.items():
        store.write(run / store.CONTRACT[stage].path(BATCH), stage, stored, ATTRIBUTES)
    return Subject(NAME, "beam", BATCH, folder)
