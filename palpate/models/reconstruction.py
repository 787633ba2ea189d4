"""The reconstruction network: charts deformed several times by features of the image and of the touches.

Only what an experiment takes is built: no image encoder without vision, no reading encoder but for strategy
`sphere`, and touch charts in the graph only where the architecture's `touch` is `graph`.
"""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor, nn

from palpate.charts.atlas import (
    ATLAS_RADIUS,
    TOUCH_VERTICES,
    chart_faces,
    resized,
    sphere,
    touch_chart,
    vision_atlas,
)
from palpate.charts.graph import Graph
from palpate.charts.sample import sample_faces
from palpate.mesh import OBJECT_POSITION
from palpate.models.encoder import ImageEncoder, ReadingEncoder
from palpate.models.gcn import GraphNetwork, initialise
from palpate.models.layers import Concatenate, LinearBlock
from palpate.models.pooling import MapProducts, PerceptualPooling, relative_camera
from palpate.models.touch import TouchAttention, TouchPooling, touches_of
from palpate.sensor import DIGIT, Sensor

HAND_SENSORS = 4  # the Allegro's
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
        strategy: whether vision charts are told of touches, and whether touch charts are copied into the mesh:
            `charts`, the paper's: both; `no_copy`: told only (in the paper's graph the touch charts are deformed
            like the others); `no_comm`: copied only; `sphere`: a closed sphere is deformed, each of its vertices
            knowing features of all touch readings (section 5.1).
        vision: whether it takes an image.
        touch: whether it takes touches.
        grasps: how many grasps it takes.
        architecture: layers and options, as in `palpate.models.architectures` and config/recipes.yaml. Of the
            options, `touch` says how vision charts are told of touches: `graph` (the paper's, if it is missing),
            touch charts are in the graph, or `pooled`, features of the nearest touches at every vertex.
            `unsuccessful` says whether the vertices of unsuccessful touch charts in the graph are deformed
            (`free`, the paper's, if it is missing) or stay at the fingertip (`held`), and `deformations` how
            often the charts are deformed (3 times, as in the paper, if it is missing), and `radius` what the
            initial sphere has, in metres (`ATLAS_RADIUS` if it is missing).
        hand_sensors: s, touches a grasp: the hand's. sensor: the kind that they are of.

    Attributes:
        faces: (F, 3) int64 faces of the mesh whose vertices `forward` gives. Vision charts come first, then touch
            charts; where these are copied, those without success have no area.
        moving_faces: (M, 3) int64, those of charts that the network moves.
        sensors: number of touches, s times the grasps, or 0.
        copies_touch: whether touch charts are added to the mesh as they are.
        shows_touch: whether the mesh has touch charts, copied or deformed.

    Raises ValueError for an option that is not known, or a combination that can't be: neither vision nor
    touch, no touch where the strategy is about touch charts, no vision for `no_comm`.
    """

    # The first layer's weights of inputs that not every model has.
    INPUT_WEIGHTS = ("image_weight", "reading_weight")

    def __init__(
        self,
        strategy: str,
        vision: bool,
        touch: bool,
        grasps: int,
        architecture: Mapping[str, Any],
        hand_sensors: int = HAND_SENSORS,
        sensor: Sensor = DIGIT,
    ):
        super().__init__()
        _check_experiment(strategy, vision, touch, grasps)
        self.hand_sensors, self.sensor = hand_sensors, sensor
        self.strategy, self.vision, self.touch = strategy, vision, touch
        self.sensors = hand_sensors * grasps if touch else 0
        path = _choice(architecture, "touch", ("graph", "pooled"))
        self.pools_touch = touch and path == "pooled" and strategy in ("charts", "no_copy")
        in_graph = self.sensors if path == "graph" and strategy in ("charts", "no_copy") else 0
        self.graph = Graph(
            in_graph,
            {"no_comm": "no_comm", "sphere": "sphere"}.get(strategy, "charts"),
            architecture["gcn"].get("normalisation", "symmetric"),
        )
        self.copies_touch = touch and (strategy == "no_comm" or (strategy == "charts" and path == "pooled"))
        self.shows_touch = self.copies_touch or in_graph > 0
        self.held = _choice(architecture, "unsuccessful", ("free", "held")) == "held"
        self.deformations = architecture.get("deformations", DEFORMATIONS)
        if self.deformations < 1:
            raise ValueError(f"{self.deformations} deformations: at least 1")
        radius = architecture.get("radius", ATLAS_RADIUS)
        self.scale = radius if architecture["normalise_positions"] else 1.0
        centre = OBJECT_POSITION if architecture["normalise_positions"] else (0.0, 0.0, 0.0)
        self.register_buffer("centre", torch.tensor(centre, dtype=torch.float64), persistent=False)
        start = sphere()[0] if strategy == "sphere" else vision_atlas().vertices
        self.register_buffer("start", resized(start, radius), persistent=False)
        faces = chart_faces(self.sensors) if self.copies_touch else self.graph.faces
        self.register_buffer("faces", faces.clone(), persistent=False)
        self._mesh_vertices = int(faces.max()) + 1
        fixed_touch = strategy == "charts" and self.held
        moving = chart_faces(0) if fixed_touch else self.graph.faces
        self.register_buffer("moving_faces", moving.clone(), persistent=False)

        of_image = self._build_encoder(dict(architecture["encoder"])) if self.vision else 0
        of_vertex = 3 + (self.graph.touch_charts > 0)
        of_readings = 0
        self.reads_readings = touch and strategy == "sphere"
        if self.reads_readings:
            self.reading_encoder = ReadingEncoder()
            of_readings = self.sensors * (self.reading_encoder.features + POSE_FEATURES)
        self.concatenate = Concatenate(-1)
        gcn, init = architecture["gcn"], architecture["init"]
        inputs = of_image + of_vertex + of_readings
        self.gcn = GraphNetwork(
            of_vertex, gcn["width"], gcn["layers"], init, architecture["last_layer_scale"], fan_in=inputs
        )
        # The first layer's weights, by what they are applied to; those of a vertex's own inputs are in `gcn`.
        width = self.gcn.layers[0].weight.shape[1]
        for name, rows in (("image_weight", of_image), ("reading_weight", of_readings)):
            if rows:
                weight = nn.Parameter(torch.empty(rows, width))
                initialise(weight, init, fan_in=inputs)
                self.register_parameter(name, weight)
        if self.pools_touch:
            self.touch_pooling = TouchPooling(width, sensor)
            # Far vertices learn of touches by attention where nothing else tells of them; beside an image it does not
            # help (docs/training.md).
            self.touch_attention = None if vision else TouchAttention(width)

    def _build_encoder(self, options: dict[str, Any]) -> int:
        """Builds the image encoder and the pooling; returns the number of features that a vertex gets."""
        alignment, project = options.pop("alignment", "extent"), options.pop("project", None)
        self.encoder = ImageEncoder(**options)
        self.pooling = PerceptualPooling(alignment, self.encoder.centres())
        features = sum(self.encoder.channels)
        self.project = LinearBlock(features, project) if project else None
        self.map_products = MapProducts()
        return project or features

    def forward(self, batch: Mapping[str, Tensor]) -> Tensor:
        """Vertices (B, V, 3) of the final mesh, metres, world frame; its faces are `faces`.

        batch, of what the experiment uses (all but the image in the world frame, metres). T is s x grasps; with
        pooled touches it may be less, for samples of fewer grasps, which then have no charts of the others:

        | key | shape | for |
        |---|---|---|
        | `image` | (B, 3, S, S), float in [0, 1] | vision |
        | `camera` | (B, 3, 4) world to homogeneous pixels of the image | vision |
        | `success` | (B, T) bool | touch |
        | `position` | (B, T, 3) of the sensors | touch |
        | `charts` | (B, T, 81, 3), not read where success is False | touch, but for `sphere` |
        | `rotation` | (B, T, 3, 3), the sensors' axes as columns | touch, pooled or `sphere` |
        | `reading` | (B, T, 3, r, c) in [0, 1] | touch, `sphere` |

        Raises ValueError if a key is missing, of another shape or type. `check` also looks at the values.
        """
        positions, mask, fixed = self._initial(batch, self._check_shapes(batch))
        positions = self.deform(batch, positions, mask, fixed)
        if self.copies_touch:
            positions = torch.cat([positions, self._touch_charts(batch)[0]])
        return positions.transpose(0, 1).contiguous()

    def _initial(self, batch: Mapping[str, Tensor], samples: int) -> tuple[Tensor, Tensor | None, Tensor | None]:
        """Initial vertices (V, B, 3); with touch charts in the graph their mask (V, B, 1), and which vertices are
        fixed (V, B, 1), or None if all move."""
        positions = self.start[:, None].expand(-1, samples, -1)
        if not self.graph.touch_charts:
            return positions, None, None
        charts, success = self._touch_charts(batch)
        mask = torch.where(success, SUCCESSFUL, UNSUCCESSFUL).to(charts.dtype)
        mask = torch.cat([mask.new_zeros(len(self.start), samples, 1), mask])
        fixed = None
        if self.strategy == "charts":
            stays = torch.ones_like(success) if self.held else success
            fixed = torch.cat([success.new_zeros(len(self.start), samples, 1), stays])
        return torch.cat([positions, charts]), mask, fixed

    def deform(
        self, batch: Mapping[str, Tensor], positions: Tensor, mask: Tensor | None, fixed: Tensor | None
    ) -> Tensor:
        """Vertices (V, B, 3) after all deformations, from what `_initial` gives."""
        image = self._image_products(batch)
        readings = self._reading_products(batch) if self.reads_readings else None
        if self.pools_touch:
            touches = touches_of(batch)
            attended = self.touch_attention.keys_and_values(batch, self._relative) if self.touch_attention else None
        for _ in range(self.deformations):
            relative = self._relative(positions)
            products = image(positions) if image else None
            if readings is not None:
                readings = readings.expand(len(positions), -1, -1)
                products = readings if products is None else products + readings
            if self.pools_touch:
                touch = self.touch_pooling(touches, positions)
                if attended:
                    touch = touch + self.touch_attention(*attended, relative)
                products = touch if products is None else products + touch
            own = relative if mask is None else self.concatenate(relative, mask)
            moved = positions + self.scale * self.gcn(own, self.graph, products)
            positions = moved if fixed is None else torch.where(fixed, positions, moved)
        return positions

    def stages(self, batch: Mapping[str, Tensor]) -> list[Tensor]:
        """What the loss of a training step looks at: the vertices that `forward` predicts."""
        return [self(batch)]

    def mesh(self, prediction: Tensor) -> tuple[Tensor, Tensor]:
        """One sample's prediction as a mesh: its vertices (V, 3), metres, world frame, and their faces."""
        return prediction, self._faces_of(len(prediction))

    def sample(self, prediction: Tensor, n: int, generator: torch.Generator | None = None) -> Tensor:
        """Points (B, n, 3) on the meshes whose vertices `forward` predicts, uniform by area."""
        return sample_faces(prediction, self._faces_of(prediction.shape[1]), n, generator)

    def _faces_of(self, vertices: int) -> Tensor:
        """`faces`, less those of touch charts that a sample with fewer grasps than the model's does not have."""
        missing = self._mesh_vertices - vertices
        return self.faces[: len(self.faces) - missing // TOUCH_VERTICES * len(touch_chart().faces)]

    def check(self, batch: Mapping[str, Tensor]) -> None:
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

    def _relative(self, positions: Tensor) -> Tensor:
        """Positions (..., 3) as the network takes them: around the object's centre, in radii of the atlas."""
        return (positions - self.centre.to(positions.dtype)) / self.scale

    def _image_products(self, batch) -> Callable[[Tensor], Tensor] | None:
        """From positions (V, B, 3) to the image's features there times their weights (V, B, width); None without."""
        if not self.vision:
            return None
        image = batch["image"]
        size = image.shape[-1]
        camera = relative_camera(batch["camera"].to(image.dtype), size)
        maps = self.encoder(image)
        if self.project:
            return lambda positions: self.project(self.pooling(maps, positions, camera, size)) @ self.image_weight
        products = self.map_products(maps, self.image_weight)
        return lambda positions: self.pooling.products(products, positions, camera, size)

    def _touch_charts(self, batch) -> tuple[Tensor, Tensor]:
        """Touch charts (81 T, B, 3), those without success all at the sensor; success (81 T, B, 1)."""
        success = batch["success"].bool()[:, :, None, None].expand(-1, -1, TOUCH_VERTICES, -1)
        charts = torch.where(success, batch["charts"], batch["position"][:, :, None])
        return tuple(x.flatten(1, 2).transpose(0, 1) for x in (charts, success))

    def _reading_products(self, batch) -> Tensor:
        """The features of all touches, of the reading, the sensor's position and rotation, and success, times their
        weights: (B, width)."""
        success = batch["success"][..., None].to(batch["reading"].dtype)
        shown = self.reading_encoder(batch["reading"].flatten(0, 1)).unflatten(0, success.shape[:2]) * success
        position = self._relative(batch["position"])
        features = torch.cat([shown, position, batch["rotation"].flatten(2), success], dim=2)
        return features.flatten(1) @ self.reading_weight

    def _shapes(self, batch) -> dict[str, tuple[int | None, ...]]:
        """The keys that are read, and their shapes after the first axis; None for a size that is free."""
        shapes: dict[str, tuple[int | None, ...]] = {}
        if self.vision:
            shapes |= {"image": (3, None, None), "camera": (3, 4)}
        if self.touch:
            touches = self.sensors
            if self.pools_touch and batch.get("success") is not None:  # any number of grasps up to its own
                touches = min(batch["success"].shape[-1], self.sensors)
            shapes |= {"success": (touches,), "position": (touches, 3)}
            if self.reads_readings or self.pools_touch:
                shapes["rotation"] = (touches, 3, 3)
            if self.reads_readings:
                shapes["reading"] = (touches, 3, *self.sensor.resolution)
            if self.strategy != "sphere":
                shapes["charts"] = (touches, TOUCH_VERTICES, 3)
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


def _choice(architecture: Mapping[str, Any], option: str, known: tuple[str, ...]) -> str:
    """The value of an option, the first of those known if it is missing; ValueError for another."""
    value = architecture.get(option, known[0])
    if value not in known:
        raise ValueError(f"{option} {value!r}; must be {' or '.join(known)}")
    return value
