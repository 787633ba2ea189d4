"""Random batches and small architectures for the tests of the networks."""

import torch

from palpate.camera import paper_camera
from palpate.charts import sphere
from palpate.mesh import OBJECT_POSITION
from palpate.models.templates import MASK, Templates, shrunk

SMALL = {
    "encoder": {
        "channels": [4, 6],
        "layers": [1, 2],
        "pool": [1, 3],
        "norm": "batch",
        "padding": 0,
    },
    "gcn": {"layers": 3, "width": 10},
    "normalise_positions": True,
    "init": "he",
    "last_layer_scale": 0.3,
}
COUNT, CAMERAS, SIZE = 20, 2, 2 * MASK  # of templates; of cameras; pixels along an edge of silhouettes
TEST_SCALES = torch.tensor([2.0, 1.0], dtype=torch.float64)


LEAST_FIT = 0.6  # some samples of a test fit as well, others not


def templates(vision=True, seed=0):
    """Ellipsoids of random sizes, and discs for silhouettes."""
    random = torch.Generator().manual_seed(seed)
    axes = 0.1 + 0.8 * torch.rand(COUNT, 1, 3, generator=random)
    centre = torch.tensor(OBJECT_POSITION)
    vertices = centre + axes * (sphere()[0] - centre)
    middle, radius = (torch.rand(COUNT, CAMERAS, n, 1, 1, generator=random) for n in (2, 1))
    rows, columns = torch.meshgrid(*[torch.linspace(0, 1, SIZE)] * 2, indexing="ij")
    away = (rows - 0.3 - 0.4 * middle[:, :, 0]).square() + (columns - 0.3 - 0.4 * middle[:, :, 1]).square()
    masks = away < (0.15 + 0.2 * radius[:, :, 0]).square()
    made = Templates(vertices, shrunk(masks) if vision else None, TEST_SCALES if vision else None)
    made.least_fit.fill_(LEAST_FIT)
    return made, masks


def silhouettes(samples: int) -> dict:
    """What a model that begins with `templates()` reads besides: every other silhouette is like none of theirs."""
    mask = templates()[1][:samples, 0]
    hand = torch.zeros_like(mask)
    hand[:, :, SIZE * 3 // 4 :] = True
    mask[1::2] = False
    mask[1::2, :9] = True
    return {"mask": mask & ~hand, "hand": hand, "camera_number": torch.zeros(samples, dtype=torch.int64)}


def resized_world(batch: dict, camera: torch.Tensor, factor: float) -> dict:
    """A batch as it would be if everything but the readings were `factor` times as large, around the object's centre.

    camera: (B, 3, 4) of the batch; the resized one sees the same pixels.
    """
    centre = torch.tensor(OBJECT_POSITION, dtype=camera.dtype)
    back = torch.eye(4, dtype=camera.dtype) / factor
    back[:3, 3], back[3, 3] = centre * (1 - 1 / factor), 1
    moved = {key: factor * (batch[key] - centre) + centre for key in ("position", "charts") if key in batch}
    return batch | moved | {"camera": camera @ back}


def random_batch(samples: int, grasps: int, seed: int = 0, size: int = 40, dtype=torch.float64) -> dict:
    """Every key that a model may read; about half of the touches are successful, at least one and not all."""
    random = torch.Generator().manual_seed(seed)

    def normal(*shape):
        return torch.randn(*shape, generator=random, dtype=dtype)

    touches = 4 * grasps
    centre = torch.tensor(OBJECT_POSITION, dtype=dtype)
    position = 0.1 * normal(samples, touches, 3) + centre
    success = torch.rand(samples, touches, generator=random) < 0.5
    success[:, 0], success[:, 1] = True, False
    return {
        "image": torch.rand(samples, 3, size, size, generator=random, dtype=dtype),
        "camera": torch.from_numpy(paper_camera(size).matrix()).to(dtype).repeat(samples, 1, 1),
        "success": success,
        "position": position,
        "rotation": torch.linalg.qr(normal(samples, touches, 3, 3))[0],
        "charts": position[:, :, None] + 0.005 * normal(samples, touches, 81, 3),
        "reading": torch.rand(samples, touches, 3, 100, 100, generator=random, dtype=dtype),
    }
