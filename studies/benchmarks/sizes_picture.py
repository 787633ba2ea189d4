"""A mug that keeps its size, and one of 0.5 m, in a grasp: `python -m studies.benchmarks.sizes_picture <path.png>`."""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from palpate.vision import Renderer  # Blender: before anything that loads embree

from palpate.batch import generator  # isort: skip
from palpate.grasp import grasp_object  # isort: skip
from palpate.mesh import OBJECT_POSITION, load_collision, load_visual, prepare  # isort: skip
from palpate.results.grasp_steps import camera_holding, hand_points  # isort: skip
from palpate.surface import sample  # isort: skip
from studies.benchmarks.grasp import HAND, POINTS, real_sizes  # isort: skip

SCALES = ("keep", "diagonal")
TOWARDS = np.array([0.75, -0.55, 0.45])  # from the object to the camera


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path)
    path, renderer, pictures = parser.parse_args().path, Renderer(samples=32, device="cpu"), []
    for scale in SCALES:
        with tempfile.TemporaryDirectory() as folder:
            real_sizes()["mug"].export(Path(folder) / "mug.ply")
            prepare(Path(folder) / "mug.ply", Path(folder) / "mug", levels=(), scale=scale)
            visual, collision = load_visual(Path(folder) / "mug"), load_collision(Path(folder) / "mug")
            points = sample(visual, POINTS, generator(0, "mug", "surface")) + OBJECT_POSITION
            grasps = grasp_object(visual, collision, points, HAND, generator(0, "mug", "grasps"))
            pose = grasps.link_pose[0]
            camera = camera_holding(np.concatenate([points, hand_points(HAND, pose)]), TOWARDS)
            pictures.append(
                renderer.render_meshes(
                    visual_glb=Path(folder) / "mug/visual.glb", hand=HAND, link_pose=pose, camera=camera
                ).rgb
            )
    Image.fromarray(np.concatenate(pictures, axis=1)).resize((1000, 500)).save(path, optimize=True)


if __name__ == "__main__":
    main()
