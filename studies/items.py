"""The items of each report: the files of a run and the config keys that each depends on.

The workflow takes the inputs of its jobs from here, so this module imports no engine.
"""

from collections.abc import Collection
from typing import NamedTuple


class Item(NamedTuple):
    """One table of a report, made by the module `studies.<report>.<item>`.

    Attributes:
        reads: the files of the run that it reads, keys of `FILES`.
        settings: the sections of the config that it depends on; `recipe` is the run's, with its overrides.
        stages: the values of `reports.stages` that select it.
    """

    reads: tuple[str, ...]
    settings: tuple[str, ...]
    stages: tuple[str, ...]


# Files and folders of a run. {batch}: the batches of the report's objects, {every_batch}: all of the run's.
FILES: dict[str, str | list[str]] = {
    "meshes": "meshes/{batch}",
    "surface": "surface/{batch}.zarr",
    "grasps": "grasps/{batch}.h5",
    "touch": "touch/{batch}.zarr",
    "charts": "charts/{batch}.zarr",
    "vision": "vision/{batch}.zarr",
    "views": "views/{batch}.zarr",
    "touch_depth": "models/touch_depth/best.ckpt",
    "training": ["catalogue.csv", "surface/{every_batch}.zarr", "vision/{every_batch}.zarr"],
    "all_objects": "catalogue.csv",
}

REPORTS: dict[str, dict[str, Item]] = {
    "error_vs_runtime": {
        "decimation": Item(("meshes",), ("mesh",), ("decimation",)),
        "surface": Item(("meshes",), ("surface",), ("surface",)),
        "grasps": Item(("meshes", "surface", "grasps"), ("grasps",), ("grasps",)),
        "patches": Item(("meshes", "surface", "grasps"), ("grasps",), ("grasps",)),
        "touch": Item(("meshes", "grasps"), ("touch", "mesh"), ("touch",)),
        "shading": Item(("meshes",), (), ("shading",)),
        "renders": Item(("meshes", "grasps"), ("vision",), ("renders",)),
        "touch_charts": Item(("meshes", "touch"), ("training",), ("touch_charts",)),
        "chamfer": Item(("meshes",), ("surface", "recipe", "evaluation"), ("chamfer",)),
        "reconstruction": Item(("meshes", "training"), ("recipe", "training", "evaluation"), ("reconstruction",)),
    },
    "stability": {
        "contact": Item(("meshes",), (), ("grasps",)),
        "geometry": Item(("meshes",), (), ("decimation", "surface")),
        "rays": Item(("meshes",), (), ("touch", "shading")),
        "losses": Item(("meshes",), (), ("touch_charts", "chamfer", "reconstruction")),
    },
    "omitted": {
        "meshes": Item(("meshes",), ("mesh",), ("decimation",)),
        "grasps": Item(("meshes", "surface", "grasps"), ("grasps",), ("grasps",)),
        "touch": Item(("meshes", "grasps"), ("touch",), ("touch",)),
        "renders": Item(("meshes", "grasps"), ("vision", "views", "seed"), ("renders",)),
        "models": Item(
            ("all_objects", "surface", "touch", "charts", "vision", "views", "touch_depth"),
            ("recipe", "training"),
            ("reconstruction",),
        ),
    },
}
# Reports that measure times: their jobs run alone.
TIMED = ("error_vs_runtime", "omitted")


def items_of_stages(report: str, stages: str | Collection[str]) -> list[str]:
    """The items of a report that `stages` (the value of `reports.stages`) selects; all of them for "all"."""
    return [name for name, item in REPORTS[report].items() if stages == "all" or set(item.stages) & set(stages)]
