"""The renderer: one Blender process that draws a whole batch of scenes, each object alone and in the hand.

A picture is two renders of Cycles: the colours, with many samples a pixel and a pixel filter; then mask and depth, with
one sample at every pixel's centre, for Cycles takes them from a pixel's first sample, which the filter moves by up to
0.75 pixels. Blender writes both as EXR files into memory (without a window a `Viewer` node stays empty).

Omitted, because the picture is the same, or within its noise (`studies/omitted/renders.py` compares): all but one
render of the object alone, one build of the hand's meshes and one hand-over of an object's geometry to Cycles; pixels
outside the rectangle of what is drawn; all samples but one for mask and depth; a file's cameras, lamps, and unused
materials; light's paths beyond the bounces in `CYCLES`, caustics, and the tree of lights.
"""

import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.vision import blender

bpy = blender.load()

from mathutils import Matrix, Vector  # noqa: E402  (Blender comes before anything else)

from palpate.batch import UnusableObject  # noqa: E402
from palpate.camera import Camera, paper_camera  # noqa: E402
from palpate.hand import Hand  # noqa: E402
from palpate.mesh import OBJECT_POSITION  # noqa: E402
from palpate.scene import LIGHTS, WHITE, Light, Scene  # noqa: E402
from palpate.vision.geom import Mesh, link_mesh  # noqa: E402
from palpate.vision.image import Image, Layers, linear, read_layers, write_layers  # noqa: E402

SAMPLES = 16
# What a scene of CAD parts under a few lamps needs of Cycles, by Blender's names.
CYCLES = {
    **{"seed": 0, "use_denoising": False, "use_adaptive_sampling": False, "use_light_tree": False},
    **{"use_auto_tile": False, "caustics_reflective": False, "caustics_refractive": False},
    **{"max_bounces": 6, "diffuse_bounces": 4, "glossy_bounces": 4, "transmission_bounces": 6},
    **{"transparent_max_bounces": 8, "volume_bounces": 0},
}
OBJECT_INDEX = 1  # Blender's pass index of the object; 0 is everything else
MARGIN = 2  # pixels around what is drawn: as far as the pixel filter reaches (0.75), and rounding
PIXEL_FILTER = 1.5  # pixels, the width of the Blackman-Harris filter: Blender's default
POINT_FILTER = 0.01  # pixels: the narrowest that Blender takes
CLIP_START = 0.1  # m, Blender's default: nearer surfaces are not seen. Of near objects it is halfway to them.
# Files here have z up. The glTF importer turns y up to z up, (x, y, z) -> (x, -z, y); this turns it back.
FILE_ROTATION = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
VISIBLE = 0.01  # opacity from which a surface counts for mask and depth: glass does, a texture's holes don't
FREE_MEMORY = 200e6  # bytes: an uncompressed picture of 2048 x 2048 takes 24 a pixel


class Renderer:
    """Blender, set up once for any number of scenes. It has one scene a process: a new Renderer replaces the last.

    samples: Cycles' samples a pixel for the colours. device: "cpu", "gpu", or "auto": a GPU if Cycles finds one.
    threads: of the CPU. exr: a folder that keeps every image as a multilayer EXR file with 32 bit floats, or None.
    centres: whether mask and depth are rendered at the pixels' centres, else those of Cycles' first sample are taken.
    Between pictures `samples`, `exr` and `cycles` (settings beside `CYCLES`, by Blender's names) may be changed. The
    steps of a picture are methods, for `studies/omitted` to replace.
    """

    _alive: weakref.ref["Renderer"] | None = None

    def __init__(
        self,
        samples: int = SAMPLES,
        device: str = "auto",
        threads: int = 1,
        exr: Path | str | None = None,
        centres: bool = True,
    ):
        self.samples, self.centres = samples, centres
        self.cycles: Mapping[str, Any] = {}
        self.exr = None if exr is None else Path(exr)
        if self.exr is not None:
            self.exr.mkdir(parents=True, exist_ok=True)
        shared = Path("/dev/shm")  # memory: for files that pass from Blender to numpy
        enough = shared.is_dir() and shutil.disk_usage(shared).free > FREE_MEMORY
        self._folder = Path(tempfile.mkdtemp(prefix="palpate-vision-", dir=shared if enough else None))
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        self._hand: Hand | None = None
        self._links: list[tuple[int, Any, np.ndarray]] = []
        bpy.ops.wm.read_factory_settings(use_empty=True)
        Renderer._alive = weakref.ref(self)
        self.device = _choose_device(device)
        self._scene = bpy.context.scene
        render, layer = self._scene.render, self._scene.view_layers[0]
        render.engine, render.resolution_percentage, render.film_transparent = "CYCLES", 100, True
        render.threads_mode, render.threads = "FIXED", threads
        render.use_compositing = render.use_sequencer = False
        render.use_border, render.use_crop_to_border = True, False
        settings = render.image_settings
        settings.file_format, settings.color_depth, settings.exr_codec = "OPEN_EXR_MULTILAYER", "32", "NONE"
        layer.use_pass_z = layer.use_pass_object_index = True
        layer.pass_alpha_threshold = VISIBLE
        self._scene.cycles.device = self.device.upper()
        self._scene.world = bpy.data.worlds.new("ambient")
        self._scene.world.use_nodes = True
        # Of a constant light the surfaces' own samples are the better ones: they follow the cosine.
        self._scene.world.cycles.sampling_method = "NONE"
        self._ambient = self._scene.world.node_tree.nodes["Background"].inputs
        self._camera = _link(self._scene, bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
        self._scene.camera = self._camera
        self._origin = _link(self._scene, bpy.data.objects.new("origin", None))
        self._plastic = bpy.data.materials.new("plastic")  # a dielectric in the colours of a mesh's attribute
        self._plastic.use_nodes = True
        nodes = self._plastic.node_tree.nodes
        colour, surface = nodes.new("ShaderNodeAttribute"), nodes["Principled BSDF"].inputs
        colour.attribute_name, surface["Roughness"].default_value = "colour", 0.45  # the hand's plastic
        self._plastic.node_tree.links.new(colour.outputs["Color"], surface["Base Color"])

    def render(self, scene: Scene) -> tuple[Image, list[Image]]:
        """The object of a scene alone, and with the hand in each of its g grasps, as `render_cameras`."""
        return self.render_cameras(scene, [scene.camera])[0]

    def render_cameras(self, scene: Scene, cameras: Sequence[Camera]) -> list[tuple[Image, list[Image]]]:
        """The images that `render` gives, from each camera; EXR files are named after object and camera. Raises
        UnusableObject if the object's file can't be read or has no triangles, or no pixel alone shows it; the next
        scene renders all the same."""
        self._take_hand(scene.hand)
        grasps = range(len(scene.link_pose))
        shots = [(replace(scene, camera=camera), f"-camera-{k}" if k else "") for k, camera in enumerate(cameras)]
        with self._temporary_data():
            self._light(scene.lights, scene.object_position)
            points = self.import_object(scene.visual_file, scene.object_position)
            unoccluded = []
            for shot, suffix in shots:
                unoccluded.append(self.draw_unoccluded(shot, points, suffix))
                if not unoccluded[-1].image(None).mask.any():
                    raise UnusableObject(
                        f"{scene.visual_file}: no pixel of {shot.camera.size} x {shot.camera.size} shows the object"
                        f"{suffix.replace('-', ' ')}: make its materials less transparent, or the object thicker"
                    )
            occluded = [[self.draw_occluded(shot, points, grasp, suffix) for grasp in grasps] for shot, suffix in shots]
        behind = None if scene.background is None else linear(scene.background)
        return [
            (alone.image(behind), [layers.image(behind) for layers in held])
            for alone, held in zip(unoccluded, occluded, strict=True)
        ]

    def draw_unoccluded(self, scene: Scene, points: np.ndarray, suffix: str = "") -> Layers:
        """The object alone. points: (n, 3) its vertices in the world. suffix: of the EXR file's name."""
        return self.draw(scene.camera, points, f"{scene.name}-unoccluded{suffix}")

    def draw_occluded(self, scene: Scene, points: np.ndarray, grasp: int, suffix: str = "") -> Layers:
        """The object with the hand in one of the scene's grasps. points: (n, 3) the object's vertices in the world."""
        points = np.concatenate([points, self.pose_hand(scene.link_pose[grasp])])
        return self.draw(scene.camera, points, f"{scene.name}-grasp-{grasp}{suffix}")

    def render_views(self, scene: Scene, cameras: Sequence[Camera]) -> list[Image]:
        """The object of a scene alone over white, from each of the cameras instead of its own. The lamps go with the
        camera, so that no view shows the dark side. Raises UnusableObject as `render_cameras` for the file."""
        self._take_hand(None)
        with self._temporary_data():
            lamps = self._light(scene.lights, scene.object_position)
            points = self.import_object(scene.visual_file, scene.object_position)
            layers = []
            for camera in cameras:
                _pose_lamps(lamps, scene.object_position, camera.rotation @ scene.camera.rotation.T)
                layers.append(self.draw(camera, points))
        return [passes.image(WHITE) for passes in layers]

    def render_meshes(
        self,
        meshes: Iterable[Mesh] = (),
        hand: Hand | None = None,
        link_pose: np.ndarray | None = None,
        camera: Camera | None = None,
        background: tuple[float, float, float] | None = WHITE,
    ) -> Image:
        """Meshes and a hand from any viewpoint, for figures; the mask has all but the hand. link_pose: (L, 4, 4) of the
        hand's links. camera: default, the paper's. background: linear RGB; None is transparent."""
        self._take_hand(hand)
        with self._temporary_data():
            self._light(LIGHTS, OBJECT_POSITION)
            drawn = [np.zeros((0, 3))]
            for number, mesh in enumerate(meshes):
                body = _link(self._scene, _blender_object(f"mesh-{number}", mesh, self._plastic))
                body.pass_index = OBJECT_INDEX
                drawn.append(np.asarray(mesh.vertices, dtype=float))
            if hand is not None:
                drawn.append(self.pose_hand(np.asarray(link_pose)))
            layers = self.draw(camera or paper_camera(), np.concatenate(drawn))
        return layers.image(background)

    @contextmanager
    def _temporary_data(self) -> Iterator[None]:
        """Remove data blocks that were added to Blender within the context; Cycles keeps its data for as long."""
        before = {block.session_uid for block in _blocks()}
        self._scene.render.use_persistent_data = True
        try:
            yield
        finally:
            self._scene.render.use_persistent_data = False  # which frees them
            bpy.data.batch_remove([block for block in _blocks() if block.session_uid not in before])

    def _take_hand(self, hand: Hand | None) -> None:
        """Build the hand's meshes, unless they are there from the scene before; hidden until posed."""
        if Renderer._alive is None or Renderer._alive() is not self:
            raise RuntimeError("a newer Renderer has taken Blender's scene: use that one")
        if hand is not None and hand is not self._hand:
            bpy.data.batch_remove([block for _, body, _ in self._links for block in (body, body.data)])
            self._hand, self._links = hand, []  # number, object, vertices (n, 3) in its frame, of links with geoms
            for link in np.unique(hand.geom_link).tolist():
                mesh = link_mesh(hand, link)
                body = _blender_object(f"hand-{hand.link_names[link]}", mesh, self._plastic)
                self._links.append((link, _link(self._scene, body), mesh.vertices))
        for _, body, _ in self._links:
            body.hide_render = True

    def import_object(self, path: Path, position: Sequence[float]) -> np.ndarray:
        """Put an object's file, its origin at a position, into Blender; returns its vertices (n, 3) in the world.
        Raises FileNotFoundError, or UnusableObject as `render_cameras`."""
        if not path.is_file():
            raise FileNotFoundError(f"{path} does not exist: expected an object's visual.glb")
        before = set(bpy.data.objects)
        try:
            with blender.quiet():
                self.read_file(path)
        except Exception as error:
            reason = str(error).strip().splitlines()[-1]
            raise UnusableObject(f"{path}: Blender can't read it as glTF ({reason})") from error
        # Textures that Blender lacks the memory for have no pixels, and it would render without them.
        if unread := [image.name for image in bpy.data.images if image.type == "IMAGE" and 0 in image.size[:]]:
            raise RuntimeError(f"{path}: Blender could not load texture {', '.join(unread)}")
        bodies = []
        for body in [body for body in bpy.data.objects if body not in before]:
            if body.parent is None:
                body.parent = self._origin
            if body.type == "MESH" and len(body.data.polygons):
                bodies.append(body)
            elif body.type != "EMPTY":  # cameras and lamps
                body.hide_render = True
        self._origin.matrix_world = Matrix([*np.c_[FILE_ROTATION, position].tolist(), [0, 0, 0, 1]])
        bpy.context.view_layer.update()
        world = [np.zeros((0, 3))]
        for body in bodies:
            body.pass_index = OBJECT_INDEX
            vertices, pose = np.empty(3 * len(body.data.vertices), dtype=np.float32), np.array(body.matrix_world)
            body.data.vertices.foreach_get("co", vertices)
            world.append(vertices.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3])
        points = np.concatenate(world)
        if not len(points) or not np.isfinite(points).all():
            raise UnusableObject(f"{path}: expected triangles with finite coordinates, found {len(points)} vertices")
        return points

    def read_file(self, path: Path) -> None:
        """Import a glTF file into Blender, without materials that nothing uses."""
        bpy.ops.import_scene.gltf(filepath=str(path), loglevel=50, import_unused_materials=False)

    def pose_hand(self, link_pose: np.ndarray) -> np.ndarray:
        """Show the hand, its links at poses (L, 4, 4); returns its vertices (n, 3) in the world."""
        points = [np.zeros((0, 3))]
        for link, body, vertices in self._links:
            pose = np.array(link_pose[link], dtype=float)
            body.matrix_world = Matrix(pose.tolist())
            body.hide_render = False
            points.append(vertices @ pose[:3, :3].T + pose[:3, 3])
        return np.concatenate(points)

    def _light(self, lights: Sequence[Light], centre: Sequence[float]) -> list[tuple[Any, Light]]:
        """Put a scene's lamps into Blender, around the object's place, and set the ambient light; returns the lamps."""
        ambient = [light.energy * linear(light.colour) for light in lights if light.kind == "ambient"]
        self._ambient["Color"].default_value = (*np.sum(ambient, axis=0), 1) if ambient else (0, 0, 0, 1)
        lamps = []
        for light in (light for light in lights if light.kind != "ambient"):
            data = bpy.data.lights.new("lamp", light.kind.upper())
            data.energy, data.color = light.energy, linear(light.colour)
            attribute = {"sun": "angle", "point": "shadow_soft_size", "area": "size"}[light.kind]
            setattr(data, attribute, np.radians(light.size) if light.kind == "sun" else light.size)
            lamps.append((_link(self._scene, bpy.data.objects.new("lamp", data)), light))
            lamps[-1][0].visible_camera = False  # what it lights is seen alone
        _pose_lamps(lamps, centre, np.eye(3))
        return lamps

    def draw(self, camera: Camera, points: np.ndarray, master: str | None = None) -> Layers:
        """Render what is in Blender. points: (n, 3) its vertices. master: the name of the EXR file that keeps the image
        if `exr` is a folder."""
        render, lens = self._scene.render, self._camera.data
        render.resolution_x = render.resolution_y = camera.size
        lens.sensor_fit, lens.lens = "HORIZONTAL", camera.focal_length / camera.size * lens.sensor_width
        self._camera.matrix_world = Matrix(camera.pose().tolist())
        for name, value in {**CYCLES, **self.cycles}.items():
            setattr(self._scene.cycles, name, value)
        rectangle = self.rectangle(camera, points)
        if rectangle is None:
            return Layers.empty(camera.size)
        _crop(self._scene.render, camera.size, *rectangle)
        lens.clip_start = max(min(CLIP_START, np.min(camera.project(points)[1]) / 2), CLIP_START / 1000)
        colour = self.render_layers(self.samples, PIXEL_FILTER)
        point = self.render_centres() if self.centres else colour
        layers = Layers(colour.combined, point.depth, point.object_index)
        if master is not None and self.exr is not None:
            write_layers(self.exr / f"{master}.exr", layers)
        return layers

    @staticmethod
    def rectangle(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Corners (2,) of the pixels in which points (n, 3) lie: (column, row), the second one outside; None if no
        point is in the image. Cycles draws the same random numbers for a pixel whatever the rectangle."""
        pixels, depth = camera.project(points)
        low, high = np.zeros(2), np.full(2, camera.size)
        if not (depth > 0).any():
            return None
        if (depth > 0).all():
            low = np.clip(np.floor(pixels.min(axis=0)) - MARGIN, 0, camera.size)
            high = np.clip(np.ceil(pixels.max(axis=0)) + MARGIN, 0, camera.size)
        return None if (low >= high).any() else (low, high)

    def render_centres(self) -> Layers:
        """Mask and depth, one sample at each pixel's centre."""
        return self.render_layers(1, POINT_FILTER)

    def render_layers(self, samples: int, filter_width: float) -> Layers:
        """Render with a number of samples a pixel and a width (pixels) of the pixel filter; OSError without space."""
        path, cycles = self._folder / "picture.exr", self._scene.cycles
        cycles.samples, cycles.filter_width, self._scene.render.filepath = samples, filter_width, str(path)
        with blender.quiet():
            bpy.ops.render.render(write_still=True)
        try:
            layers = read_layers(path)
        except Exception as error:  # Blender goes on after a failure to write
            raise OSError(f"{path}: the picture was not written whole: is there space left?") from error
        path.unlink()  # nothing is left in memory if the process is killed later
        return layers


def _blocks() -> list:
    """All of Blender's data blocks but the picture that it renders."""
    return [block for block in bpy.data.user_map() if getattr(block, "type", None) != "RENDER_RESULT"]


def _choose_device(device: str) -> str:
    """Tell Cycles which devices it may use; returns "cpu" or "gpu"."""
    if device not in ("auto", "cpu", "gpu"):
        raise ValueError(f"device {device!r}: expected auto, cpu or gpu")
    if device == "cpu":
        return "cpu"
    preferences = bpy.context.preferences.addons["cycles"].preferences
    for kind in ("OPTIX", "CUDA", "HIP", "ONEAPI", "METAL"):
        try:
            preferences.compute_device_type = kind
        except TypeError:  # this build of Blender doesn't know the kind
            continue
        devices = [entry for entry in preferences.get_devices_for_type(kind) if entry.type == kind]
        for entry in devices:
            entry.use = True
        if devices:
            return "gpu"
    if device == "gpu":
        raise RuntimeError("device gpu: Cycles finds none (driver missing?); use device cpu or auto")
    return "cpu"


def _pose_lamps(lamps: Iterable[tuple[Any, Light]], centre: Sequence[float], turn: np.ndarray) -> None:
    """Put lamps where their lights are, turned by a rotation (3, 3) about the object's place `centre` (3,)."""
    for body, light in lamps:
        target = centre if light.target is None else light.target
        position = np.array(light.position)
        away = turn @ (position - target)
        body.location = centre + turn @ (position - centre)
        body.rotation_euler = Vector(away).to_track_quat("Z", "Y").to_euler()


def _link(scene: Any, body: Any) -> Any:
    """Put an object into a scene; returns it."""
    scene.collection.objects.link(body)
    return body


def _blender_object(name: str, mesh: Mesh, material: Any) -> Any:
    """A Blender object with smooth shading and colours, not yet in a scene."""
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.int32)
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(vertices))
    data.vertices.foreach_set("co", vertices.ravel())
    data.loops.add(faces.size)
    data.loops.foreach_set("vertex_index", faces.ravel())
    data.polygons.add(len(faces))
    data.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    data.update(calc_edges=True)
    data.shade_smooth()
    if mesh.normals is None:
        data.set_sharp_from_angle(angle=np.radians(30))
    else:
        data.normals_split_custom_set_from_vertices(np.asarray(mesh.normals, dtype=float).tolist())
    colours = np.asarray(mesh.colours, dtype=float)
    by_face = colours.shape == (len(faces), 3) and len(faces) != len(vertices)
    rgba = np.ones((len(faces) * 3 if by_face else len(vertices), 4), dtype=np.float32)
    rgba[:, :3] = linear(np.repeat(colours, 3, axis=0) if by_face else colours)
    attribute = data.color_attributes.new("colour", "FLOAT_COLOR", "CORNER" if by_face else "POINT")
    attribute.data.foreach_set("color", rgba.ravel())
    data.materials.append(material)
    return bpy.data.objects.new(name, data)


def _crop(render: Any, size: int, low: np.ndarray, high: np.ndarray) -> None:
    """Render only the rectangle between two corners, pixels as (column, row), of an image."""
    inside = 0.1  # pixels: Blender rounds down
    render.border_min_x, render.border_max_x = (low[0] + inside) / size, (high[0] + inside) / size
    render.border_min_y, render.border_max_y = (size - high[1] + inside) / size, (size - low[1] + inside) / size
