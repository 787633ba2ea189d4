"""The stages of the pipeline that write one output a batch, as one table: every list of stages follows from it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Stage:
    """One stage: what its rule reads and writes, at `<run>/<name>/<batch><suffix>`.

    Attributes:
        name: of its folder, its rule and its script. suffix: of its output; empty: a folder of meshes.
        reads: names of the stages that it reads.
        rejects: whether it can reject objects, in `rejected/<name>/<batch>.csv`.
        in_dataset: whether its output is part of the dataset; the others belong to models.
        engines: packages whose versions its stores record.
        simulated: whether a dataset that was read, not simulated, lacks it.
    """

    name: str
    suffix: str
    reads: tuple[str, ...]
    rejects: bool
    in_dataset: bool
    engines: tuple[str, ...] = ()
    simulated: bool = False

    def path(self, batch: str = "{batch}") -> str:
        """Its output of one batch, relative to the run's folder; by default the pattern of all batches."""
        return f"{self.name}/{batch}{self.suffix}"

    def rejected(self, batch: str = "{batch}") -> str:
        """Its table of rejected objects of one batch."""
        return f"rejected/{self.name}/{batch}.csv"


STAGES = {
    stage.name: stage
    for stage in (
        Stage("meshes", "", (), True, True, simulated=True),
        Stage("surface", ".zarr", ("meshes",), True, True, ("trimesh", "embreex")),
        Stage("grasps", ".h5", ("meshes",), True, True, ("mujoco", "trimesh"), simulated=True),
        Stage("touch", ".zarr", ("meshes", "grasps"), True, True, ("trimesh", "embreex")),
        Stage("vision", ".zarr", ("meshes", "grasps"), True, True, ("bpy",)),
        Stage("views", ".zarr", ("meshes",), True, False, ("bpy",)),
        Stage("charts", ".zarr", ("touch",), False, False, ("torch",)),
        Stage("rings", ".zarr", ("meshes", "touch"), False, False, ("trimesh", "embreex")),
    )
}
