"""Random batches and small architectures for the tests of the networks."""

import torch

from palpate.camera import paper_camera
from palpate.mesh import OBJECT_POSITION

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
