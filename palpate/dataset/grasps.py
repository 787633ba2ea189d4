"""The grasps of a run as a map-style dataset: an item is a dictionary of one grasp's arrays."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from operator import index as integer
from typing import Any

from palpate.catalogue import CatalogueEntry
from palpate.configuration import not_among
from palpate.dataset.run import Run
from palpate.store.contract import CONTRACT, ArraySpec, arrays_by_name
from palpate.store.files import StoreError

# What a sensor reads at each frame: `Run.read` makes it of the stored depth.
FRAMES_READING = replace(
    CONTRACT["touch"].arrays["reading"],
    shape=(*"ogfsrc", 3),
    dimensions=("object", "grasp", "frame", "sensor", "row", "column", "colour"),
    meaning="Image of the gel",
)
COLOURS = ("RGB", "sRGB")  # units of arrays whose last axis is the colour


class GraspDataset(Sequence):
    """The grasps of some objects, object by object: `grasps[i]` is a dictionary, read when it is asked for.

    An item has `object`, `class` and `split` (text), `grasp` (its number, from 0), and the arrays of the grasp and of
    its object, in the contract's shapes and types without the axes o, g and k (docs/dataset.md). All items have the
    same shapes, so that the default collation stacks them: `points` (s, rc, 3) are 0 past `point_count`. A sensor that
    touched nothing reads the empty gel. An object's array that is named as one of a grasp has its stage before it:
    `surface_points`; those of its frames have `frames_`.
    camera: whose images, masks, depths and matrices are read; None for those of all, with an axis k.

    Attributes: arrays, the names of the arrays; sources, their stages and contracts by name; images, which of them are
    pictures, and whether these have colours. Raises StoreError if there is no object, or a stage that the arrays
    need is missing; KeyError, with the right names, for an unknown array."""

    unit, units = "grasp", "grasps"  # what an item is of

    def __init__(
        self,
        run: Run,
        entries: Iterable[CatalogueEntry],
        stages: Iterable[str],
        arrays: Iterable[str] | None,
        camera: int | None = 0,
    ):
        self._run, self._entries, self._camera = run, list(entries), camera
        if not self._entries:
            why = "rejected.csv, or the config's `split`, says why"
            raise StoreError(f"{run.folder}: no object to take {self.units} of: {why}")
        self._of_object = getattr(run, self.units)(self._entries[0])
        known = self._known()
        if arrays is None:
            arrays = [name for name, (stage, spec) in known.items() if stage in stages and self._stored(stage, spec)]
        self.arrays = tuple(arrays)
        if unknown := [name for name in self.arrays if name not in known]:
            raise KeyError(f"array of {self.units}: {not_among(unknown[0], known)}")
        self.sources = {name: known[name] for name in self.arrays}
        pictures = {name: spec for name, (_, spec) in self.sources.items() if spec.dtype == "uint8"}
        self.images = {name: spec.unit in COLOURS for name, spec in pictures.items()}

    @staticmethod
    def _known() -> dict[str, tuple[str, ArraySpec]]:
        """Stage and contract of each array, by its name in an item."""
        of_grasps, of_objects = arrays_by_name("grasp"), arrays_by_name("object")
        of_frames = arrays_by_name("frame") | {"reading": ("frames", FRAMES_READING)}
        return {
            **of_grasps,
            **{f"frames_{name}": source for name, source in of_frames.items()},
            **{f"{source[0]}_{name}" if name in of_grasps else name: source for name, source in of_objects.items()},
        }

    def _stored(self, stage: str, spec: ArraySpec) -> bool:
        """Whether the first object has the array: optional ones may be missing."""
        name = "depth" if spec == FRAMES_READING else spec.name
        return self._run.has(stage) and name in self._run.store(stage, self._entries[0].batch)

    def dimensions(self, name: str) -> tuple[str, ...]:
        """Names of the axes of an array in an item."""
        spec = self.sources[name][1]
        names = spec.dimensions[1 + (spec.row != "object") :]
        return tuple(axis for axis in names if axis != "camera" or self._camera is None)

    def __len__(self) -> int:
        return len(self._entries) * self._of_object

    def __getitem__(self, index: int) -> dict[str, Any]:  # type: ignore[override]  # no slices
        """The arrays of a grasp, with its object, class, split and number. Raises IndexError if there is none."""
        try:
            number, grasp = divmod(range(len(self))[integer(index)], self._of_object)
        except IndexError:
            raise IndexError(f"{self.unit} {index} of {len(self)}") from None
        entry = self._entries[number]
        item: dict[str, Any] = {"object": entry.object, "class": entry.class_name, "split": entry.split}
        item[self.unit] = grasp
        for name, (stage, spec) in self.sources.items():
            place: tuple[int | slice, ...] = () if spec.row == "object" else (grasp,)
            place += (slice(None),) if spec.row == "frame" else ()
            if spec.of_cameras and self._camera is not None:
                place += (self._camera,)
            item[name] = self._run.read(stage, spec.name, entry, place)
        return item

    def __repr__(self) -> str:
        size = f"{len(self)} {self.units} of {len(self._entries)} objects"
        return f"{type(self).__name__}({size}: {', '.join(self.arrays)})"


class PressDataset(GraspDataset):
    """The presses of some objects, object by object, as `GraspDataset` has grasps. An item has `object`, `class`,
    `split`, `press` (its number, from 0), and the arrays of the press."""

    unit, units = "press", "presses"

    @staticmethod
    def _known() -> dict[str, tuple[str, ArraySpec]]:
        return arrays_by_name("press")
