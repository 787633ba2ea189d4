"""The grasps of a run as a map-style dataset: an item is a dictionary of one grasp's arrays."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from operator import index as integer

import numpy as np

from palpate.catalogue import CatalogueEntry
from palpate.dataset.arrays import fill_untouched, shaded
from palpate.dataset.run import Run
from palpate.store.contract import CONTRACT, ArraySpec, arrays_by_name
from palpate.store.files import Store, StoreError

# What a sensor reads at each frame: made of the stored depth.
FRAMES_READING = replace(CONTRACT["touch"].arrays["reading"], shape=(*"ogfsrc", 3), meaning="Image of the gel")
COLOURS = ("RGB", "sRGB")  # units of arrays whose last axis is the colour


class GraspDataset(Sequence):
    """The grasps of some objects, object by object: `grasps[i]` is a dictionary, read when it is asked for.

    loader = torch.utils.data.DataLoader(dataset.grasps("train", ["reading", "occluded"]), batch_size=8, num_workers=2)

    An item has `object`, `class` and `split` (text), `grasp` (its number, from 0), and the arrays of the grasp and of
    its object, in the contract's shapes and types without the axes o, g and k (docs/dataset.md). All items have the
    same shapes, so that the default collation stacks them: `points` (s, rc, 3) are 0 past `point_count`. A sensor that
    touched nothing reads the empty gel. An object's array that is named as one of a grasp has its stage before it:
    `surface_points`; those of its frames have `frames_`.
    camera: whose images, masks, depths and matrices are read; None for those of all, with an axis k.

    Attributes: arrays, the names of the arrays; sources, their stages and contracts by name; images, which of them are
    pictures, and whether these have colours. Raises StoreError if there is no object, or a stage that the arrays
    need is missing; KeyError, with the right names, for an unknown array.
    """

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
            raise StoreError(f"{run.folder}: no object to take grasps of; rejected.csv says why")
        self._of_object = run.grasps(self._entries[0])
        known = _named_arrays()
        if arrays is None:
            arrays = [name for name, (stage, spec) in known.items() if stage in stages and self._stored(stage, spec)]
        self.arrays = tuple(arrays)
        if unknown := [name for name in self.arrays if name not in known]:
            raise KeyError(f"no array {', '.join(map(repr, unknown))} of grasps; there are {', '.join(known)}")
        self.sources = {name: known[name] for name in self.arrays}
        pictures = {name: spec for name, (_, spec) in self.sources.items() if spec.dtype == "uint8"}
        self.images = {name: spec.unit in COLOURS for name, spec in pictures.items()}

    def _stored(self, stage: str, spec: ArraySpec) -> bool:
        """Whether the first object has the array: optional ones may be missing."""
        name = "depth" if spec == FRAMES_READING else spec.name
        return self._run.has(stage) and name in self._run.store(stage, self._entries[0].batch)

    def __len__(self) -> int:
        return len(self._entries) * self._of_object

    def __getitem__(self, index: int) -> dict[str, np.ndarray | str | int]:
        try:
            number = range(len(self))[integer(index)]
        except IndexError:
            raise IndexError(f"grasp {index} of {len(self)}") from None
        number, grasp = divmod(number, self._of_object)
        entry = self._entries[number]
        item = {"object": entry.object, "class": entry.class_name, "split": entry.split, "grasp": grasp}
        stages = dict.fromkeys(stage for stage, _ in self.sources.values())
        places = {stage: (self._run.store(stage, entry.batch), self._run.row(stage, entry)) for stage in stages}
        return item | {
            name: self._read(*places[stage], grasp, stage, spec) for name, (stage, spec) in self.sources.items()
        }

    def _read(self, store: Store, row: int, grasp: int, stage: str, spec: ArraySpec) -> np.ndarray:
        place = (row, grasp) if spec.of_grasps else (row,)
        if spec == FRAMES_READING:
            return shaded(store.get("depth", place), self._run.sensor(store.path.stem, stage))
        place += (slice(None),) if spec.of_frames else ()
        if spec.of_cameras and self._camera is not None:
            place += (self._camera,)
        values = store.get(spec.name, place)
        if (stage, spec.name) == ("touch", "reading"):
            return fill_untouched(values, store.get("success", place), store.get("empty_reading"))
        return values

    def __repr__(self) -> str:
        return f"GraspDataset({len(self)} grasps of {len(self._entries)} objects: {', '.join(self.arrays)})"


def _named_arrays() -> dict[str, tuple[str, ArraySpec]]:
    """Stage and contract of each array, by its name in an item."""
    of_grasps, of_objects = arrays_by_name(of_grasps=True), arrays_by_name(of_grasps=False)
    of_frames = arrays_by_name(of_grasps=True, of_frames=True) | {"reading": ("frames", FRAMES_READING)}
    found = {f"frames_{name}": source for name, source in of_frames.items()}
    return (
        of_grasps
        | found
        | {
            (f"{stage}_{name}" if name in of_grasps else name): (stage, spec)
            for name, (stage, spec) in of_objects.items()
        }
    )
