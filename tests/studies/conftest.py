"""A run of which reports on pictures read something: a glb file, and grasps."""

import numpy as np
import pytest

from palpate import shapes
from palpate.hand import allegro
from palpate.mesh import DIAGONAL
from palpate.store import join, write
from studies.subjects import Subject
from tests.results.conftest import grasp_record
from tests.vision.scenes import grasp_poses


@pytest.fixture(scope="session")
def pictured(tmp_path_factory):
    """A run's folder and its only subject, a bottle so light that its bounces of light show."""
    run = tmp_path_factory.mktemp("pictured")
    subject = Subject("bottle-0006", "bottle", "batch-0000", run / "meshes/batch-0000/bottle-0006")
    subject.folder.mkdir(parents=True)
    scene = shapes.make("bottle", 6)
    low, high = scene.bounds
    to_canonical = np.eye(4) * DIAGONAL / np.linalg.norm(high - low)
    to_canonical[:3, 3], to_canonical[3, 3] = -to_canonical[0, 0] * (low + high) / 2, 1
    scene.apply_transform(to_canonical)
    (subject.folder / "visual.glb").write_bytes(scene.export(file_type="glb"))
    hand = allegro()
    palm = grasp_poses(hand)[0][0]
    poses = [(palm, hand.open_joint_positions + bend) for bend in (0.3, 0.5)]
    arrays = join("grasps", {subject.name: grasp_record(hand, poses)})
    arrays |= {f"hand/{name}": array for name, array in hand.to_arrays().items()}
    write(run / "grasps/batch-0000.h5", "grasps", arrays, {"made_from": {}, "seed": 0})
    return run, subject
