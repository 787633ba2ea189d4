"""Open-X-Tactile, the layout that FTP-1 trains on: a store of Zarr format 2 for each split.

<folder>/<split>.zarr/data/<array>        (t, ...): the frames of all episodes, one after another
                     /meta/episode_ends   (e,) int64: number of frames up to the end of each episode
                     /grasps/<array>      (e, ...): what the layout has no name for
         and what every export has: palpate.interchange.folder

https://github.com/michaelyuancb/ftp1-policy, data_processing/README.md. A grasp is an episode of one frame.
"""

import json
from collections.abc import Mapping
from pathlib import Path

import numcodecs
import numpy as np
import zarr
from scipy.spatial.transform import Rotation

from palpate.dataset import GraspDataset
from palpate.interchange.items import with_progress

FRAMES = 16  # of a chunk
HELD = 4 * FRAMES  # in memory before they are written, 2 MB each; Zarr compresses their chunks side by side
# Arrays that the layout has a name for. The built-in hand is a left one: seen on its palm, fingers up, its thumb is on
# the left. The palm's pose becomes (x, y, z, rotation vector), without a turn to the layout's wrist.
TACTILE = "left_tactile"
NAMES = {"occluded": "camera_main_rgb", "reading": f"{TACTILE}_data_fingers", "palm_pose": "left_wrist_pose"}
AREAS = {"thumb": 0, "index": 1, "middle": 2, "ring": 3, "little": 4}  # FTP-1's functional areas of finger tips


def write_open_x_tactile(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split; `camera_main_rgb` is the first camera's. `folder` has `sensor.json` for readings.

    Raises ValueError if a sensor has no area by its name in `AREAS`; two sensors are a gripper's, areas 0 and 1.
    """
    with_touch = "reading" in next(iter(splits.values())).sources
    same = _of_sensors(json.loads((folder / "sensor.json").read_text())) if with_touch else {}
    same["data/timestamps"] = np.int64(0)  # number of the frame in its episode
    for split, grasps in splits.items():
        root, rows, objects, classes = zarr.create_group(folder / f"{split}.zarr", zarr_format=2), [], [], []
        for number, item in enumerate(with_progress(grasps, split), start=1):
            rows.append(_by_path({name: item[name] for name in ("grasp", *grasps.sources)}) | same)
            objects.append(item["object"])
            classes.append(item["class"])
            if len(rows) == HELD or number == len(grasps):
                _append(root, {path: np.stack([row[path] for row in rows]) for path in rows[0]})
                rows = []
        instructions = [f"grasp the {name}" for name in classes]
        _append(root, {"grasps/object": np.array(objects), "data/sub_task_instruction": np.array(instructions)})
        _append(root, {"meta/episode_ends": np.arange(1, len(grasps) + 1, dtype=np.int64)})


def _of_sensors(stated: Mapping) -> dict[str, np.ndarray]:
    """Kind, type and functional areas of the sensors of `sensor.json`, by their paths in the store."""
    names = stated["names"]
    areas = [0, 1] if len(names) == 2 else [AREAS.get(name) for name in names]
    if None in areas:
        known = ", ".join(AREAS)
        raise ValueError(f"Open-X-Tactile has areas of {known}, but the hand's sensors are called {', '.join(names)}")
    values = {"sensor": stated["sensor"]["name"], "type": "image", "area": areas}
    return {f"data/{TACTILE}_{key}_fingers": np.array(value) for key, value in values.items()}


def _by_path(item: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A grasp's arrays in the layout's forms, by their paths in the store."""
    found = {f"data/{NAMES[name]}" if name in NAMES else f"grasps/{name}": values for name, values in item.items()}
    if "palm_pose" in item:
        place, turn = item["palm_pose"][:3, 3], Rotation.from_matrix(item["palm_pose"][:3, :3])
        found[f"data/{NAMES['palm_pose']}"] = np.append(place, turn.as_rotvec())
    if "occluded" in item and item["occluded"].ndim == 4:  # of several cameras
        found |= {f"data/{NAMES['occluded']}": item["occluded"][0], "grasps/occluded": item["occluded"]}
    return found


def _append(root: zarr.Group, arrays: Mapping[str, np.ndarray]) -> None:
    """Append arrays (t, ...), which are made where they are not there."""
    for path, values in arrays.items():
        if path not in root:
            shape, codec = values.shape[1:], numcodecs.Blosc("zstd", 1, numcodecs.Blosc.SHUFFLE)
            root.create_array(path, shape=(0, *shape), dtype=values.dtype, chunks=(FRAMES, *shape), compressors=codec)
        root[path].append(values)
