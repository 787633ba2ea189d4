"""Use a trained model: from an image and the touches of a grasp to a mesh. From Python `palpate.reconstruct`, or:
palpate reconstruct results/default template_occluded_any bottle-0011 --output x.ply"""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from palpate.configuration import nearest
from palpate.dataset.reader import GraspRecord, ObjectRecord
from palpate.experiments import Experiment
from palpate.rebuild_command import rebuild_command
from palpate.store import CONTRACT, Store

if TYPE_CHECKING:
    import trimesh

CHECKPOINT = "best.ckpt"
# By which a rotation times its transpose may differ from the identity: measured poses are good to that.
ROTATION = 1e-3
FLAT = 1e12  # condition number of a projection that maps the scene to a line or a point
FORMATS = (".ply", ".glb", ".obj")  # that keep colours
# sRGB; Okabe and Ito's sky blue, made paler, and vermilion: apart for colour-blind readers.
VISION_COLOUR = (0.56, 0.76, 0.90)
TOUCH_COLOUR = (0.84, 0.37, 0.00)


class GraspTouches(NamedTuple):
    """Readings and poses of the sensors of one grasp: what a model needs of a grasp record."""

    reading: np.ndarray  # (s, r, c, 3) uint8 images of the gels
    position: np.ndarray  # (s, 3) metres, world
    rotation: np.ndarray  # (s, 3, 3), world; columns are the sensor's axes
    success: np.ndarray  # (s,) bool, whether the sensor touches the object


Grasp = GraspTouches | GraspRecord
Grasps = Grasp | Sequence[Grasp] | None


class Silhouette(NamedTuple):
    """Where the object is seen in an image, for models that begin with a training object."""

    mask: np.ndarray  # (s, s) bool, the object
    hand: np.ndarray | None = None  # (s, s) bool, what may hide it; None: nothing
    view: int = 0  # number of the camera


class Inputs(NamedTuple):
    """What a `Reconstructor` is called with; `reconstruct` says what each is."""

    image: np.ndarray | None = None
    touches: Grasps = None
    camera: np.ndarray | None = None
    silhouette: Silhouette | None = None


class Shape(NamedTuple):
    """A reconstruction in the world frame, metres: the object's centre is at `palpate.mesh.OBJECT_POSITION`."""

    vertices: np.ndarray  # (V, 3) float32
    faces: np.ndarray  # (F, 3) int64
    touch: np.ndarray  # (F,) bool, whether a face belongs to the chart of a successful touch

    def mesh(self) -> "trimesh.Trimesh":
        """The charts as one mesh, not joined: touch charts in one colour, all else in another."""
        import trimesh

        colours = np.tile((*VISION_COLOUR, 1.0), (len(self.vertices), 1))
        colours[self.faces[self.touch].ravel(), :3] = TOUCH_COLOUR
        return trimesh.Trimesh(self.vertices, self.faces, vertex_colors=colours, process=False)


class ReconstructionError(ValueError):
    """A model can't be used with the given inputs; the message names the problem and the remedy."""


def reconstruct(
    image: np.ndarray | None = None,
    touches: Grasps = None,
    *,
    model: Path | str,
    camera: np.ndarray | None = None,
    silhouette: Silhouette | None = None,
    closed: bool = False,
    device: str = "cpu",
) -> "trimesh.Trimesh":
    """The mesh that a trained model predicts from one image, from touches, or from both.
    image: (s, s, 3) uint8 sRGB, row 0 at the top; of (s, s, 4) the last channel is opacity. camera: (3, 4) the image's,
    from homogeneous world coordinates to pixels; models that were trained on several cameras, or on views, need it, the
    others take that of their training. silhouette: of the object in the image, which models of strategy `template`
    need; faces that it shows to be empty space are left out, unless `closed`. touches: one grasp, or a sequence of as
    many as the model takes: grasp records of `palpate.Dataset`, or `GraspTouches`. What the model does not take is
    ignored. model: its folder, `<run>/models/<experiment>/seed-<k>`, or the checkpoint in it; a model that takes touch
    charts also reads the run's U-Net, `<run>/models/touch_depth`.
    Returns a mesh in the world frame, metres (the object's centre at (0, 0, 0.6)): the charts as they are, touch charts
    in another colour. Without any successful touch there is a warning: the model only knows where sensors are. Raises
    ReconstructionError for a model that is not there, a missing image or touch, and values of another shape or not
    finite. For many objects, make one `Reconstructor`."""
    return Reconstructor(model, device)(image, touches, camera, silhouette, closed).mesh()


class Reconstructor:
    """A trained model, loaded once: `model(image, touches) -> Shape`, `model.predict(record) -> Shape`. Raises
    ReconstructionError if the model is not there (naming those that are), its run has no U-Net, or the device can't be
    used; CheckpointError as `palpate.learning.checkpoints.load` does."""

    def __init__(self, model: Path | str, device: str = "cpu"):
        self.path = checkpoint(model)
        import torch  # after what can be wrong without it

        from palpate.learning import checkpoints

        try:
            torch.empty(0, device=device)
        # torch's errors for a device it does not know, was built without, or can compute nothing on.
        except (RuntimeError, AssertionError, NotImplementedError) as error:
            reason = str(error).strip().partition("\n")[0]
            raise ReconstructionError(f"device {device!r} can't be used here ({reason}): use cpu") from None
        content = checkpoints.read(self.path, "reconstruction")
        self._model = checkpoints.model_of(self.path, content).to(device)
        self.experiment: Experiment = checkpoints.experiment_of(content)
        self._camera, self._image_size = content.get("camera"), content.get("image_size")
        self._charts: TouchCharts | None = None
        if self.experiment.takes_charts:
            self._charts = TouchCharts(self.path.parents[2] / "touch_depth", device)
            own = self._model.sensor
            checkpoints.require_sensor(None, own, None, self._charts.model.sensor, f"{self.path} (but not its U-Net)")

    @property
    def name(self) -> str:  # the experiment's
        return self.path.parents[1].name

    @property
    def grasps(self) -> range:  # the numbers of grasps that the model takes the touches of
        experiment = self.experiment
        return range(experiment.fewest_grasps, experiment.grasps + 1) if experiment.touch else range(1)

    def __call__(
        self,
        image: np.ndarray | None = None,
        touches: Grasps = None,
        camera: np.ndarray | None = None,
        silhouette: Silhouette | None = None,
        closed: bool = False,
    ) -> Shape:
        """The prediction from one image and the touches of some grasps; see `reconstruct`."""
        import torch

        from palpate.learning.samples import to_colours

        inputs: dict[str, np.ndarray] = {}
        success = np.zeros(0, dtype=bool)
        if self.experiment.has_vision:
            inputs |= self._image_inputs(image, camera, silhouette)
        if self.experiment.touch:
            sensors = self._all_touches(touches)
            poses = {"position": sensors.position, "rotation": sensors.rotation}
            inputs |= {name: values.astype(np.float32) for name, values in poses.items()}
            inputs["success"] = success = sensors.success
            inputs |= {"charts": self._charts(sensors)} if self._charts else {"reading": sensors.reading}
        device = next(self._model.parameters()).device
        batch = {name: torch.from_numpy(array)[None].to(device) for name, array in inputs.items()}
        # As a training's, also in memory: convolutions round otherwise in another layout.
        batch |= {name: to_colours(batch[name]) for name in ("image", "reading") if name in batch}
        with torch.inference_mode():
            vertices, faces = (values.cpu().numpy() for values in self._model.meshes(batch, closed)[0])
        if not np.isfinite(vertices).all():
            raise ReconstructionError(f"{self.path} predicts NaN or infinite vertices: train the model again")
        return self._shape(vertices, faces, success)

    def predict(
        self, record: ObjectRecord, grasps: Sequence[int] | None = None, view: int = 0, closed: bool = False
    ) -> Shape:
        """The prediction for an object of the dataset, from what the model takes of it; arguments of `of_object`."""
        return self(*of_object(record, self.experiment, grasps, view), closed)

    def predictions(self, record: ObjectRecord, grasps: Sequence[int] | None = None) -> dict[int, "trimesh.Trimesh"]:
        """Meshes of an object record by the number of the grasp: from each of some grasps, or of all. A model that
        takes several grasps only, or none, makes one mesh of the first ones, which stands for each."""
        numbers = list(range(len(record.grasps))) if grasps is None else list(grasps)
        if self.experiment.takes_grasps and (self.experiment.grasps == 1 or self.experiment.fewer_grasps):
            return {number: self.predict(record, [number]).mesh() for number in numbers}
        return dict.fromkeys(numbers, self.predict(record).mesh())

    def _image_inputs(
        self, image: np.ndarray | None, camera: np.ndarray | None, silhouette: Silhouette | None
    ) -> dict[str, np.ndarray]:
        if image is None:
            raise ReconstructionError(f"{self.name} takes an image ({self.experiment.vision} vision): give one")
        image = np.asarray(image)
        size = None if camera is not None or self._camera is None else self._image_size
        square = image.ndim == 3 and image.shape[0] == image.shape[1] and image.shape[2] in (3, 4)
        if not square or (size and len(image) != size):
            wanted = f"({size}, {size}, 3)" if size else "(s, s, 3)"
            remedy = "; of another size, give its camera" if square else ""
            raise ReconstructionError(f"the image has shape {image.shape}, expected {wanted}{remedy}")
        if image.dtype != np.uint8:
            _check_finite("the image", image)
            raise ReconstructionError(f"the image is of type {image.dtype}, expected uint8 (sRGB, 0 to 255)")
        projection = np.asarray(self._camera if camera is None else camera)
        if projection.shape != (3, 4):  # () of None
            raise ReconstructionError(
                f"{self.name} was trained on several cameras: give the image's camera (3, 4), from "
                f"homogeneous world coordinates to pixels (found an array of shape {projection.shape})"
            )
        _check_finite("the camera", projection)
        if not np.linalg.cond(projection.astype(float)[:, :3]) < FLAT:
            raise ReconstructionError("invalid camera: its projection (3, 4) maps the scene to a line or a point")
        inputs = {"image": image, "camera": projection.astype(np.float32)}
        if not self.experiment.takes_masks:
            return inputs
        if silhouette is None:
            remedy = "give one; of an object of a dataset, Reconstructor.predict gives it"
            raise ReconstructionError(f"{self.name} also takes the object's silhouette in the image: {remedy}")
        hand = np.zeros(image.shape[:2]) if silhouette.hand is None else silhouette.hand
        for key, values in {"mask": silhouette.mask, "hand": hand}.items():
            inputs[key] = np.asarray(values, dtype=bool)
            if inputs[key].shape != image.shape[:2]:
                shapes = f"shape {inputs[key].shape}, expected the image's {image.shape[:2]}"
                raise ReconstructionError(f"the silhouette's {key} has {shapes}")
        return inputs | {"camera_number": np.asarray(silhouette.view)}

    def _all_touches(self, touches: Grasps) -> GraspTouches:
        """All sensors of all grasps in one, checked."""
        given: Any = () if touches is None else touches  # also of a class of the caller's, with the same attributes
        grasps, model = [given] if hasattr(given, "reading") else list(given), self._model
        if len(grasps) not in self.grasps:
            taken = f"{self.grasps[0]} to " * (len(self.grasps) > 1) + _counted(self.grasps[-1])
            raise ReconstructionError(f"{self.name} takes {taken}, but touches of {len(grasps)} were given")
        for grasp in grasps:  # records of a dataset say what they are of; `GraspTouches` do not
            kind = getattr(grasp, "sensor", model.sensor)
            if differs := model.sensor.geometry_difference(kind):
                raise ReconstructionError(
                    f"{self.name} was trained with sensor {model.sensor.name!r}, but the touches are of "
                    f"{kind.name!r}: {differs}; take a model of their run"
                )
        if not grasps:
            readings = np.zeros((0, *model.sensor.resolution, 3), dtype=np.uint8)
            return GraspTouches(readings, np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, dtype=bool))
        names = GraspTouches._fields
        sensors = GraspTouches(*(np.concatenate([getattr(grasp, name) for grasp in grasps]) for name in names))
        count = (model.hand_sensors or 0) * len(grasps)
        shapes = (count, *model.sensor.resolution, 3), (count, 3), (count, 3, 3), (count,)
        for name, values, shape in zip(sensors._fields, sensors, shapes, strict=True):
            if values.shape != shape:
                of = f"{name} of {_counted(len(grasps))}"
                raise ReconstructionError(f"touches: {of} has shape {values.shape}, expected {shape}")
            _check_finite(f"touches: {name}", values)
        turned = np.asarray(sensors.rotation, dtype=float)
        if np.abs(turned @ turned.swapaxes(1, 2) - np.eye(3)).max() > ROTATION or (np.linalg.det(turned) < 0).any():
            raise ReconstructionError("touches: rotation must be rotation matrices: orthonormal, with determinant 1")
        if sensors.reading.dtype != np.uint8:
            raise ReconstructionError(f"touches: reading is of type {sensors.reading.dtype}, expected uint8")
        if not sensors.success.any():
            warnings.warn(
                f"no sensor of {_counted(len(grasps))} touches the object: {self.name} is only given where they are",
                stacklevel=4,
            )
        return sensors._replace(success=sensors.success.astype(bool))

    def _shape(self, vertices: np.ndarray, faces: np.ndarray, success: np.ndarray) -> Shape:
        """The mesh, with its faces of successful touches; `success` (T,) of the touches that the model was given."""
        from palpate.charts import touch_chart

        touch = np.zeros(len(faces), dtype=bool)
        if not (self.experiment.takes_charts and self._model.shows_touch):  # no touch charts in the mesh
            return Shape(vertices, faces, touch)
        touched_faces = np.repeat(success, len(touch_chart().faces))
        others = len(faces) - len(touched_faces)
        touch[others:] = touched_faces
        if self._model.copies_touch:  # charts without success are points
            shown = touch | (np.arange(len(faces)) < others)
            faces, touch = faces[shown], touch[shown]
        return Shape(vertices, faces, touch)


class TouchCharts:
    """The run's U-Net and the fit of charts: `charts(touches) -> (k, 81, 3)` metres, world frame.
    touch_depth: its folder or checkpoint."""

    def __init__(self, touch_depth: Path | str, device: str = "cpu"):
        self.path = checkpoint(touch_depth)
        from palpate.learning.checkpoints import load_touch_depth
        from palpate.touch import empty_reading

        self.model = load_touch_depth(self.path).to(device)
        stores = sorted(self.path.parents[2].glob(CONTRACT["touch"].path("*")))  # of the run, if it has any
        self.empty_reading = Store(stores[0]).empty_reading if stores else empty_reading(self.model.sensor)

    def __call__(self, touches: Grasp) -> np.ndarray:
        """Charts of k sensors; those of sensors that touch nothing are all at the sensor's position."""
        from palpate.learning.touch_charts import touch_charts

        position, rotation = np.asarray(touches.position), np.asarray(touches.rotation)
        reading, success = np.asarray(touches.reading), np.asarray(touches.success, dtype=bool)
        try:
            return touch_charts(self.model, reading, self.empty_reading, success, position, rotation)
        except ValueError as error:  # of the fit: NaN in the predicted cloud
            raise ReconstructionError(f"no touch charts from what {self.path} predicts: {error}") from error

    def clouds(self, touches: Grasp) -> list[np.ndarray]:
        """Predicted local clouds (n, 3) of the successful sensors, world frame; charts are fitted to them."""
        import torch

        from palpate.learning.touch_charts import masked_clouds, predict_depth

        touched = np.asarray(touches.success, dtype=bool)
        depth, valid = predict_depth(self.model, touches.reading[touched], self.empty_reading)
        clouds = masked_clouds(depth.cpu(), valid.cpu(), self.model.sensor.size)
        poses = torch.from_numpy(touches.rotation[touched]), torch.from_numpy(touches.position[touched])
        return [
            (cloud.double() @ rotation.T + position).numpy()
            for cloud, rotation, position in zip(clouds, *poses, strict=True)
        ]


def checkpoint(model: Path | str) -> Path:
    """The checkpoint of a model's folder, or the one named. Needs no torch. Raises ReconstructionError, naming the
    models that its run has, if it is not there."""
    path = Path(model)
    file = path if path.suffix == ".ckpt" else path / CHECKPOINT
    if file.is_file():
        return file
    if file.parent.name == "touch_depth":
        unet = "the U-Net that turns readings into charts lies beside the run's experiments"
        raise ReconstructionError(f"{file} does not exist: {unet}; train it with: {rebuild_command(file)}")
    known = trained(next((folder for folder in file.parents if folder.name == "models"), path))
    nothing = f", and nothing is trained there; train it with: {rebuild_command(file)}"
    raise ReconstructionError(f"{file} does not exist" + (f"; trained are: {', '.join(known)}" if known else nothing))


def trained(models: Path | str) -> list[str]:
    """Names `<experiment>/seed-<k>` of the models that a run's folder `models` has."""
    models = Path(models)
    return sorted(str(path.parent.relative_to(models)) for path in models.glob(f"*/seed-*/{CHECKPOINT}"))


def named_model(models: Path, experiment: str, seed: int | None = None) -> Path:
    """The checkpoint of an experiment in a run's folder `models`: of a seed, or of the first that is trained. Raises
    ReconstructionError, naming the models that the run has, if there is none."""
    known = trained(models)
    seeds = [int(name.rpartition("-")[2]) for name in known if name.split("/")[0] == experiment]
    if seed is None and not seeds:
        hint = nearest(experiment, dict.fromkeys(name.split("/")[0] for name in known))
        others = f"trained are: {', '.join(known)}{hint}" if known else f"nothing is: {rebuild_command(models, 'all')}"
        raise ReconstructionError(f"no experiment {experiment!r} is trained in {models}; {others}")
    return checkpoint(models / experiment / f"seed-{min(seeds) if seed is None else seed}")


def of_object(
    record: ObjectRecord, experiment: Experiment, grasps: Sequence[int] | None = None, view: int = 0
) -> Inputs:
    """The inputs of a model of an experiment from an object of the dataset. grasps: numbers; by default the first, as
    many as it takes; an occluded image is that of the first. view: number of the view, or of the camera. Raises
    ReconstructionError for a grasp or view that the object does not have."""
    available = record.grasps if experiment.takes_grasps else []
    default = range(min(experiment.grasps, len(available)) if experiment.fewer_grasps else experiment.grasps)
    numbers = list(default if grasps is None else grasps)
    if experiment.takes_grasps and (wrong := [number for number in numbers if not 0 <= number < len(available)]):
        raise ReconstructionError(f"{record.name} has no grasp {wrong[0]}: it has {len(available)}, numbered from 0")
    touches = [available[number] for number in numbers] if experiment.touch else None
    if experiment.vision == "views":
        images = record.image
        if not 0 <= view < len(images):
            raise ReconstructionError(f"{record.name} has no view {view}: it has {len(images)}, numbered from 0")
        return Inputs(images[view], touches, record.camera[view])
    if not experiment.has_vision:
        return Inputs(touches=touches)
    try:
        seen = (record if experiment.vision == "unoccluded" else available[numbers[0]]).seen_by(view)
    except IndexError as error:
        raise ReconstructionError(str(error)) from None
    image, silhouette = seen.unoccluded if experiment.vision == "unoccluded" else seen.occluded, None
    if experiment.takes_masks and experiment.vision == "unoccluded":
        silhouette = Silhouette(seen.unoccluded_mask > 0, view=view)
    elif experiment.takes_masks:
        mask = seen.occluded_mask > 0
        silhouette = Silhouette(mask, np.isfinite(seen.occluded_depth) & ~mask, view)
    return Inputs(image, touches, seen.vision_camera.matrix(), silhouette)


def _counted(grasps: int) -> str:
    return f"{grasps} grasp" if grasps == 1 else f"{grasps} grasps"


def _check_finite(what: str, values: np.ndarray) -> None:
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise ReconstructionError(f"{what} has NaN or infinite values")
