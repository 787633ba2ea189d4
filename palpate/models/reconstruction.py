"""The reconstruction network: charts deformed several times by features of the image and of the touches.

Only what an experiment takes is built: no image encoder without vision, no reading encoder but for strategy
`sphere`, and a graph with just the touch charts of its grasps.
"""

from collections.abc import Mapping
from typing import Any

import torch
from torch import nn

from palpate.camera import IMAGE_SIZE, paper_camera
from palpate.charts.atlas import ATLAS_RADIUS, TOUCH_VERTICES, chart_faces, sphere, vision_atlas
from palpate.charts.graph import Graph
from palpate.charts.sample import sample_faces
from palpate.hand import SENSORS
from palpate.mesh import OBJECT_POSITION
from palpate.models.encoder import ImageEncoder, ReadingEncoder
from palpate.models.gcn import GraphNetwork
from palpate.models.layers import Concatenate, LinearBlock
from palpate.models.pooling import PerceptualPooling, relative_camera
from palpate.touch.sensor import RESOLUTION

STRATEGIES = ("charts", "no_copy", "no_comm", "sphere")
DEFORMATIONS = 3  # section 3.1
# The mask feature. The supplement: 0 for vision charts, a binary feature for a successful touch; the
# published code tells unsuccessful touches apart from both.
SUCCESSFUL, UNSUCCESSFUL = 1.0, -1.0
# Beside a reading's features, in strategy `sphere`: the sensor's position, rotation, and success.
POSE_FEATURES = 3 + 9 + 1


class Reconstruction(nn.Module):
    """From an image, touches, or both, to the vertices of a mesh (paper, section 3 and supplement).

    Args:
        strategy: `charts`, the paper's; `no_copy`: touch charts are deformed like the others; `no_comm`:
            touch charts are no part of the graph, and only added to the mesh; `sphere`: a closed sphere is
            deformed, each of its vertices knowing features of all touch readings (section 5.1).
        vision: whether it takes an image.
        touch: whether it takes touches.
        grasps: how many grasps it takes, four touches each.
        architecture: layers and options, as in `palpate.models.architectures` and config/recipes.yaml. Of the
            options, `unsuccessful` says whether the vertices of unsuccessful touch charts are deformed
            (`free`, the paper's, if it is missing) or stay at the fingertip (`held`), and `deformations` how
            often the charts are deformed (3 times, as in the paper, if it is missing).

    Attributes:
        faces: (F, 3) int64 faces of the mesh whose vertices `forward` gives; those of a touch chart without
            success have no area in `no_comm`.
        sensors: number of touches, 4 times the grasps, or 0.
        pooled: number of features that the image gives a vertex.

    Raises ValueError for an option that is not known, or a combination that can't be: neither vision nor
    touch, no touch where the strategy is about touch charts, no vision for `no_comm`.
    """

    def __init__(
        self,
        strategy: str,
        vision: bool,
        touch: bool,
        grasps: int,
        architecture: Mapping[str, Any],
    ):
        super().__init__()
        _check_experiment(strategy, vision, touch, grasps)
        self.strategy, self.vision, self.touch = strategy, vision, touch
        self.sensors = SENSORS * grasps if touch else 0
        deformed = self.sensors if strategy in ("charts", "no_copy") else 0
        kind = {"no_comm": "no_comm", "sphere": "sphere"}.get(strategy, "charts")
        self.graph = Graph(deformed, kind, architecture["gcn"].get("normalisation", "symmetric"))
        unsuccessful = architecture.get("unsuccessful", "free")
        if unsuccessful not in ("free", "held"):
            raise ValueError(f"unsuccessful {unsuccessful!r}; must be free or held")
        self.held = unsuccessful == "held"
        self.deformations = architecture.get("deformations", DEFORMATIONS)
        if self.deformations < 1:
            raise ValueError(f"{self.deformations} deformations: at least 1")
        self.scale = ATLAS_RADIUS if architecture["normalise_positions"] else 1.0
        centre = OBJECT_POSITION if architecture["normalise_positions"] else (0.0, 0.0, 0.0)
        self.register_buffer("centre", torch.tensor(centre, dtype=torch.float64), persistent=False)
        start = sphere()[0] if strategy == "sphere" else vision_atlas().vertices
        self.register_buffer("start", start.clone(), persistent=False)
        copied = self.sensors if strategy == "no_comm" else 0
        faces = chart_faces(copied) if copied else self.graph.faces
        self.register_buffer("faces", faces.clone(), persistent=False)

        self.pooled = self._build_encoder(dict(architecture["encoder"])) if self.vision else 0
        inputs = self.pooled + 3
        if deformed:
            inputs += 1
        self.reads_readings = touch and strategy == "sphere"
        if self.reads_readings:
            norm = architecture["encoder"]["norm"] if vision else "batch"
            self.reading_encoder = ReadingEncoder(norm=norm)
            inputs += self.sensors * (self.reading_encoder.features + POSE_FEATURES)
        self.concatenate = Concatenate(-1)
        gcn = architecture["gcn"]
        self.gcn = GraphNetwork(
            inputs, gcn["width"], gcn["layers"], architecture["init"], architecture["last_layer_scale"]
        )

    def _build_encoder(self, options: dict[str, Any]) -> int:
        """Builds the image encoder and the pooling; returns the number of features that a vertex gets."""
        alignment, project = options.pop("alignment", "extent"), options.pop("project", None)
        self.encoder = ImageEncoder(**options)
        self.pooling = PerceptualPooling(alignment, self.encoder.centres())
        camera = paper_camera()
        matrix = torch.from_numpy(camera.intrinsics() @ camera.extrinsics())
        self.register_buffer("camera", relative_camera(matrix, IMAGE_SIZE), persistent=False)
        features = sum(self.encoder.channels)
        self.project = LinearBlock(features, project) if project else None
        return project or features

    def forward(self, batch: Mapping[str, torch.Tensor]) -> torch.Tensor:
        """Vertices (B, V, 3) of the final mesh, metres, world frame; its faces are `faces`.

        batch, of what the experiment uses (T = 4 x grasps; all but the image in the world frame, metres):

        | key | shape | for |
        |---|---|---|
        | `image` | (B, 3, S, S), float in [0, 1] | vision |
        | `camera` | (B, 3, 4) world to homogeneous pixels; the dataset's if missing | vision |
        | `success` | (B, T) bool | touch |
        | `position` | (B, T, 3) of the sensors | touch |
        | `charts` | (B, T, 81, 3), not read where success is False | touch, but for `sphere` |
        | `rotation`, `reading` | (B, T, 3, 3), (B, T, 3, 100, 100) in [0, 1] | touch, `sphere` |

        Raises ValueError if a key is missing, of another shape or type. `check` also looks at the values.
        """
        positions = self.deform(batch, *self._initial(batch, self._check_shapes(batch)))
        if self.touch and self.strategy == "no_comm":
            positions = torch.cat([positions, self._touch_charts(batch)[0]])
        return positions.transpose(0, 1).contiguous()

    def _initial(
        self, batch: Mapping[str, torch.Tensor], samples: int
    ) -> tuple[torch.Tensor, list[torch.Tensor], torch.Tensor | None]:
        """Initial vertices (V, B, 3), their constant features (V, B, ...), and which vertices are fixed (V, B, 1).

        The last is None if all vertices move.
        """
        positions = self.start[:, None].expand(-1, samples, -1)
        given = []
        enforced = None
        if self.graph.touch_charts:
            charts, success = self._touch_charts(batch)
            positions = torch.cat([positions, charts])
            mask = torch.where(success, SUCCESSFUL, UNSUCCESSFUL).to(charts.dtype)
            given.append(torch.cat([mask.new_zeros(len(self.start), samples, 1), mask]))
            if self.strategy == "charts":
                stays = torch.ones_like(success) if self.held else success
                enforced = torch.cat([success.new_zeros(len(self.start), samples, 1), stays])
        if self.reads_readings:
            given.append(self._touch_features(batch).expand(len(positions), -1, -1))
        return positions, given, enforced

    def deform(
        self,
        batch: Mapping[str, torch.Tensor],
        positions: torch.Tensor,
        given: list[torch.Tensor],
        enforced: torch.Tensor | None,
    ) -> torch.Tensor:
        """Vertices (V, B, 3) after all deformations, from what `_initial` gives."""
        maps, camera = self._image_maps(batch)
        for _ in range(self.deformations):
            features = [*given]
            if self.vision:
                pooled = self.pooling(maps, positions, camera, batch["image"].shape[-1])
                features.insert(0, self.project(pooled) if self.project else pooled)
            features.insert(int(self.vision), self._relative(positions))
            moved = positions + self.scale * self.gcn(self.concatenate(*features), self.graph)
            positions = moved if enforced is None else torch.where(enforced, positions, moved)
        return positions

    def mesh(self, prediction: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """One sample's prediction as a mesh: its vertices (V, 3), metres, world frame, and `faces`."""
        return prediction, self.faces

    def sample(self, prediction: torch.Tensor, n: int, generator: torch.Generator | None = None) -> torch.Tensor:
        """Points (B, n, 3) on the meshes whose vertices `forward` predicts, uniform by area."""
        return sample_faces(prediction, self.faces, n, generator)

    def check(self, batch: Mapping[str, torch.Tensor]) -> None:
        """Raises ValueError if a key is missing, of another shape, or has NaN or infinite values.

        For where data come in: it reads every value, which a training step should not wait for.
        """
        self._check_shapes(batch)
        for key in self._shapes(batch):
            values = batch[key]
            if key == "charts":
                values = values[batch["success"].bool()]
            if not bool(torch.isfinite(values).all()):
                where = "" if key != "charts" else " of a successful touch"
                raise ValueError(f"{key}: NaN or infinite values{where}")

    def _relative(self, positions: torch.Tensor) -> torch.Tensor:
        """Positions (..., 3) as the network takes them: around the object's centre, in radii of the atlas."""
        return (positions - self.centre.to(positions.dtype)) / self.scale

    def _image_maps(self, batch):
        """The image's maps, and the camera relative to the image, or twice None."""
        if not self.vision:
            return None, None
        image = batch["image"]
        camera = self.camera.to(image.dtype)
        if batch.get("camera") is not None:
            camera = relative_camera(batch["camera"].to(image.dtype), image.shape[-1])
        return self.encoder(image), camera

    def _touch_charts(self, batch) -> tuple[torch.Tensor, torch.Tensor]:
        """Touch charts (81 T, B, 3), those without success all at the sensor; success (81 T, B, 1)."""
        success = batch["success"].bool()[:, :, None, None].expand(-1, -1, TOUCH_VERTICES, -1)
        charts = torch.where(success, batch["charts"], batch["position"][:, :, None])
        return tuple(x.flatten(1, 2).transpose(0, 1) for x in (charts, success))

    def _touch_features(self, batch) -> torch.Tensor:
        """(B, features) of all touches: of the reading, the sensor's position and rotation, and success."""
        success = batch["success"][..., None].to(batch["reading"].dtype)
        shown = self.reading_encoder(batch["reading"].flatten(0, 1)).unflatten(0, success.shape[:2]) * success
        position = self._relative(batch["position"])
        return torch.cat([shown, position, batch["rotation"].flatten(2), success], dim=2).flatten(1)

    def _shapes(self, batch) -> dict[str, tuple[int | None, ...]]:
        """The keys that are read, and their shapes after the first axis; None for a size that is free."""
        shapes: dict[str, tuple[int | None, ...]] = {}
        if self.vision:
            shapes["image"] = (3, None, None)
            if batch.get("camera") is not None:
                shapes["camera"] = (3, 4)
        if self.touch:
            shapes |= {"success": (self.sensors,), "position": (self.sensors, 3)}
            if self.reads_readings:
                shapes["rotation"] = (self.sensors, 3, 3)
                shapes["reading"] = (self.sensors, 3, RESOLUTION, RESOLUTION)
            if self.strategy != "sphere":
                shapes["charts"] = (self.sensors, TOUCH_VERTICES, 3)
        return shapes

    def _check_shapes(self, batch) -> int:
        """Number of samples in the batch; ValueError if something is missing or of another shape."""
        shapes = self._shapes(batch)
        missing = [key for key in shapes if batch.get(key) is None]
        if missing:
            raise ValueError(
                f"the batch has no {', '.join(missing)}: this model has strategy {self.strategy}, "
                f"vision {self.vision}, touch {self.touch}"
            )
        samples = len(batch[next(iter(shapes))])
        for key, shape in shapes.items():
            found = tuple(batch[key].shape)
            fits = len(found) == 1 + len(shape) and found[0] == samples
            if not fits or any(want not in (None, size) for want, size in zip(shape, found[1:], strict=True)):
                wanted = ", ".join("S" if size is None else str(size) for size in (samples, *shape))
                raise ValueError(f"{key} has shape {found}, expected ({wanted})")
            if key != "success" and not batch[key].is_floating_point():
                raise ValueError(f"{key} is {batch[key].dtype}, expected floating point")
        if self.vision:
            height, width = batch["image"].shape[2:]
            if height != width:
                raise ValueError(f"image is {height} x {width}, expected a square")
            self.encoder.sizes(width)
        return samples


def _check_experiment(strategy: str, vision: bool, touch: bool, grasps: int) -> None:
    if strategy not in STRATEGIES:
        raise ValueError(f"strategy {strategy!r}: choose one of {list(STRATEGIES)}")
    if not (vision or touch):
        raise ValueError("a model needs vision, touch, or both")
    if strategy in ("no_copy", "no_comm") and not touch:
        raise ValueError(f"strategy {strategy} is about touch charts: it needs touch")
    if strategy == "no_comm" and not vision:
        raise ValueError("strategy no_comm without vision would deform the vision charts without knowing anything")
    if grasps < 1:
        raise ValueError(f"{grasps} grasps: at least 1")
