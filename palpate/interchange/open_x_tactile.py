"""Open-X-Tactile, the layout that FTP-1 trains on: a store of Zarr format 2 for each split.

<folder>/<split>.zarr/data/<array>             (t, ...): the frames of all episodes, one after another
                     /meta/episode_ends        (e,) int64: number of frames up to the end of each episode
                     /meta/object, grasp       (e,): of each episode; what every export has: palpate.interchange.folder

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

FRAMES = 16  # of a chunk, and held in memory before they are written
# Arrays that the layout has a name for. The built-in hand is a left one: seen on its palm, fingers up, its thumb is on
# the left. The palm's pose becomes (x, y, z, rotation vector), without a turn to the layout's wrist.
TACTILE = "left_tactile_{}_fingers"
NAMES = {"occluded": "camera_main_rgb", "reading": TACTILE.format("data"), "palm_pose": "left_wrist_pose"}
AREAS = {"thumb": 0, "index": 1, "middle": 2, "ring": 3, "little": 4}  # FTP-1's functional areas of finger tips


def write_open_x_tactile(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split; `camera_main_rgb` is the first camera's. `folder` has `sensor.json` for readings.

    Raises ValueError if a sensor has no area by its name in `AREAS`; two sensors are a gripper's, areas 0 and 1.
    """
    with_touch = "reading" in next(iter(splits.values())).sources
    sensors = _sensors(json.loads((folder / "sensor.json").read_text())) if with_touch else {}
    for split, grasps in splits.items():
        root, rows, episodes = zarr.create_group(folder / f"{split}.zarr", zarr_format=2), [], []
        for number, item in enumerate(with_progress(grasps, split), start=1):
            episodes.append([item[name] for name in ("object", "class", "grasp")])
            rows.append(_frame({name: item[name] for name in grasps.sources}))
            if len(rows) == FRAMES or number == len(grasps):
                _append(root, "data", {name: np.stack([row[name] for row in rows]) for name in rows[0]})
                rows = []
        objects, classes, numbers = map(np.array, zip(*episodes, strict=True))
        of_frames = {"timestamps": np.zeros(len(grasps), np.int64)}  # numbers of frames in their episode
        of_frames["sub_task_instruction"] = np.char.add("grasp the ", classes)
        of_frames |= {TACTILE.format(key): np.array([value] * len(grasps)) for key, value in sensors.items()}
        _append(root, "data", of_frames)
        ends = np.arange(1, len(grasps) + 1, dtype=np.int64)
        _append(root, "meta", {"episode_ends": ends, "object": objects, "grasp": numbers})


def _sensors(stated: Mapping) -> dict:
    """Kind, type of data and functional areas of the sensors of `sensor.json`."""
    names = stated["names"]
    areas = [0, 1] if len(names) == 2 else [AREAS.get(name) for name in names]
    if None in areas:
        known = ", ".join(AREAS)
        raise ValueError(f"Open-X-Tactile has areas of {known}, but the hand's sensors are called {', '.join(names)}")
    return {"sensor": stated["sensor"]["name"], "type": "image", "area": areas}


def _frame(item: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A grasp's arrays in the layout's names and forms."""
    frame = {NAMES.get(name, name): values for name, values in item.items()}
    if "palm_pose" in item:
        place, turn = item["palm_pose"][:3, 3], Rotation.from_matrix(item["palm_pose"][:3, :3])
        frame[NAMES["palm_pose"]] = np.append(place, turn.as_rotvec())
    if "occluded" in item and item["occluded"].ndim == 4:  # of several cameras
        frame |= {NAMES["occluded"]: item["occluded"][0], "occluded": item["occluded"]}
    return frame


def _append(root: zarr.Group, group: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Append arrays (t, ...), which are made where they are not there."""
    for name, values in arrays.items():
        path, codec = f"{group}/{name}", numcodecs.Blosc("zstd", 1, numcodecs.Blosc.SHUFFLE)
        if path not in root:
            shape, chunks = (0, *values.shape[1:]), (FRAMES, *values.shape[1:])
            root.create_array(path, shape=shape, chunks=chunks, dtype=values.dtype, compressors=codec)
        root[path].append(values)
