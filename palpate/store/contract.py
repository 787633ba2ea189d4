"""The dataset contract: which arrays each store has, and their shapes, types, units and frames, as data.

A shape is written with symbols (see `SYMBOLS`); within one store a symbol stands for one number. Everything that
writes, reads, checks or documents a store goes by this table.
"""

from dataclasses import dataclass

SCHEMA_VERSION = 1
SENSORS = 4  # fingertips, in this order: index, middle, ring, thumb
SENSOR_NAMES = ("index", "middle", "ring", "thumb")

SYMBOLS = {
    "o": "objects of the batch",
    "og": "grasps of the batch: o times g, object-major (row = object x g + grasp)",
    "n": "surface points of an object (10000)",
    "j": "joints of the hand (16)",
    "l": "links of the hand",
    "r": "rows and columns of a reading (100)",
    "rr": "r x r, the pixels of a reading",
    "p": "rows and columns of an image (256)",
}

UNITS = {"length": "metre", "angle": "radian", "colour": "sRGB, 8 bit"}
FRAMES = {
    "world": "right-handed, z up; the object's bounding box is centred at (0, 0, 0.6), its diagonal is 0.5",
    "rotation": "3 x 3 matrices; columns are the frame's axes in the world",
    "sensor": "x out of the gel, y along the columns and z along the rows of a reading",
    "image": "row 0 at the top",
}


@dataclass(frozen=True)
class ArraySpec:
    """One array of one store. `record` is how many leading axes are cut into chunks of length one."""

    name: str
    shape: tuple[str | int, ...]
    dtype: str
    record: int
    meaning: str
    unit: str = ""
    fill: float | int | bool | str = 0

    def sizes(self, shape: tuple[int, ...]) -> dict[str, int]:
        """The value of each symbol that an array of this shape gives.

        Raises ValueError if the number of axes, a fixed axis or a repeated symbol disagrees.
        """
        if len(shape) != len(self.shape):
            raise ValueError(f"{len(self.shape)} axes {self.text()} expected, but the shape is {shape}")
        found: dict[str, int] = {}
        for axis, length in zip(self.shape, shape, strict=True):
            expected = axis if isinstance(axis, int) else found.setdefault(axis, length)
            if length != expected:
                raise ValueError(f"shape {self.text()} expected, but it is {shape}")
        return found

    def chunk(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Shape of one record, which is the unit of reading; never 0 along an axis."""
        return tuple(1 if axis < self.record else max(length, 1) for axis, length in enumerate(shape))

    def text(self) -> str:
        """The symbolic shape as it is printed, for example `(og, 4, r, r)`."""
        axes = ", ".join(str(axis) for axis in self.shape)
        return f"({axes},)" if len(self.shape) == 1 else f"({axes})"


@dataclass(frozen=True)
class StoreSpec:
    """One kind of store: a folder of batches under the run, made by one stage."""

    stage: str
    suffix: str
    target: str
    engines: tuple[str, ...]
    arrays: dict[str, ArraySpec]
    groups: tuple[str, ...] = ()

    def path(self, batch: str) -> str:
        """Path of one batch's store, relative to the run's folder."""
        return f"{self.stage}/{batch}{self.suffix}"


def _table(*arrays: ArraySpec) -> dict[str, ArraySpec]:
    objects = ArraySpec(
        "object", ("o",), "string", 0, "Names of the batch's objects, in catalogue order", fill=""
    )
    return {spec.name: spec for spec in (objects, *arrays)}


CONTRACT = {
    "surface": StoreSpec(
        "surface",
        ".zarr",
        "surface",
        ("trimesh", "embreex"),
        _table(
            ArraySpec(
                "points",
                ("o", "n", 3),
                "float32",
                1,
                "Points on the object's exterior surface, uniform by area; world frame",
                "m",
            ),
        ),
    ),
    "grasps": StoreSpec(
        "grasps",
        ".h5",
        "grasps",
        ("mujoco", "trimesh"),
        _table(
            ArraySpec("object_index", ("og",), "int32", 0, "Index of the grasp's object in `object`"),
            ArraySpec("grasp_index", ("og",), "int32", 0, "Number of the grasp within its object, from 0"),
            ArraySpec(
                "joint_positions", ("og", "j"), "float64", 1, "Joint angles of the hand at rest", "rad"
            ),
            ArraySpec(
                "palm_pose",
                ("og", 4, 4),
                "float64",
                1,
                "Pose of the palm, homogeneous: +x palm normal, +z along the fingers; world frame",
                "m",
            ),
            ArraySpec("link_pose", ("og", "l", 4, 4), "float64", 1, "Pose of every link; world frame", "m"),
            ArraySpec(
                "sensor_position", ("og", SENSORS, 3), "float64", 1, "Sensor origins; world frame", "m"
            ),
            ArraySpec(
                "sensor_rotation",
                ("og", SENSORS, 3, 3),
                "float64",
                1,
                "Sensor axes as columns; world frame",
            ),
            ArraySpec(
                "touches",
                ("og", SENSORS),
                "bool",
                0,
                "Whether the sensor touches the object, as judged when grasping",
                fill=False,
            ),
            ArraySpec(
                "penetration",
                ("og",),
                "float32",
                0,
                "Worst depth of the hand in the object or in itself, by a check independent of the engine",
                "m",
            ),
            ArraySpec("attempts", ("o",), "int32", 0, "Grasps tried for the object"),
        ),
        groups=("hand",),
    ),
    "touch": StoreSpec(
        "touch",
        ".zarr",
        "touch",
        ("trimesh", "embreex"),
        _table(
            ArraySpec(
                "success",
                ("og", SENSORS),
                "bool",
                0,
                "Whether the sensor touches the object: some geometry is within its range",
                fill=False,
            ),
            ArraySpec("position", ("og", SENSORS, 3), "float64", 0, "Sensor origins; world frame", "m"),
            ArraySpec("rotation", ("og", SENSORS, 3, 3), "float64", 0, "Sensor axes as columns; world frame"),
            ArraySpec(
                "depth",
                ("og", SENSORS, "r", "r"),
                "float32",
                2,
                "Distance from the sensor plane along the sensor's x; +inf where nothing is in range",
                "m",
                fill=float("inf"),
            ),
            ArraySpec(
                "reading",
                ("og", SENSORS, "r", "r", 3),
                "uint8",
                2,
                "Image of the gel; 0 (not written) for a sensor that touched nothing, which reads "
                "`empty_reading`",
                "RGB",
            ),
            ArraySpec(
                "points",
                ("og", SENSORS, "rr", 3),
                "float32",
                2,
                "Local cloud: the surface in range, one point a finite pixel of `depth`, row-major; rows past "
                "`point_count` are 0; world frame",
                "m",
            ),
            ArraySpec("point_count", ("og", SENSORS), "int32", 0, "Points in the local cloud"),
            ArraySpec("empty_reading", ("r", "r", 3), "uint8", 0, "Image of the untouched gel", "RGB"),
        ),
    ),
    "vision": StoreSpec(
        "vision",
        ".zarr",
        "vision",
        ("bpy",),
        _table(
            ArraySpec("unoccluded", ("o", "p", "p", 3), "uint8", 1, "Image of the object alone", "sRGB"),
            ArraySpec("occluded", ("og", "p", "p", 3), "uint8", 1, "Image of the object in the hand", "sRGB"),
            ArraySpec(
                "unoccluded_mask", ("o", "p", "p"), "uint8", 1, "255 where the object is seen, 0 elsewhere"
            ),
            ArraySpec(
                "occluded_mask", ("og", "p", "p"), "uint8", 1, "255 where the object is seen, 0 elsewhere"
            ),
            ArraySpec(
                "unoccluded_depth",
                ("o", "p", "p"),
                "float16",
                1,
                "Distance along the camera's axis; +inf in the background",
                "m",
                fill=float("inf"),
            ),
            ArraySpec(
                "occluded_depth",
                ("og", "p", "p"),
                "float16",
                1,
                "Distance along the camera's axis; +inf in the background",
                "m",
                fill=float("inf"),
            ),
        ),
    ),
}
