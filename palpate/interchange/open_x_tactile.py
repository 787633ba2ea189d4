"""Open-X-Tactile, the layout that FTP-1 trains on: a store of Zarr format 2 for each split.

<folder>/<split>.zarr/data/<array>        (t, ...): the frames of all episodes, one after another
                     /meta/episode_ends   (e,) int64: number of frames up to the end of each episode
                     /frames/<array>      (t, ...), /grasps/<array> (e, ...): what the layout has no name for
         and what every export has: palpate.interchange.folder

https://github.com/michaelyuancb/ftp1-policy, data_processing/README.md. A grasp is an episode: of its frames if the run
has them, else of one frame.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numcodecs
import numpy as np
import zarr
from scipy.spatial.transform import Rotation

from palpate.dataset import GraspDataset
from palpate.interchange.items import TEXT, Place, with_progress

FRAMES = 16  # of a chunk
HELD = 4 * FRAMES  # frames in memory before they are written, 2 MB each; Zarr compresses their chunks side by side
# Arrays that the layout has a name for. The built-in hand is a left one: seen on its palm, fingers up, its thumb is on
# the left. The palm's pose becomes (x, y, z, rotation vector), without a turn to the layout's wrist.
TACTILE = "left_tactile"
NAMES = {"occluded": "camera_main_rgb", "reading": f"{TACTILE}_data_fingers", "palm_pose": "left_wrist_pose"}
AREAS = {"thumb": 0, "index": 1, "middle": 2, "ring": 3, "little": 4}  # FTP-1's functional areas of finger tips


def write_open_x_tactile(folder: Path, splits: Mapping[str, GraspDataset]) -> None:
    """Write the grasps of each split; `camera_main_rgb` is the first camera's. `folder` has `sensor.json` for readings.

    Raises ValueError if a sensor has no area by its name in `AREAS`; two sensors are a gripper's, areas 0 and 1.
    """
    with_touch = {"reading", "frames_reading"} & {*next(iter(splits.values())).sources}
    same = _of_sensors(json.loads((folder / "sensor.json").read_text())) if with_touch else {}
    first = next(iter(splits.values()))
    of_frames, axes = _of_frames(first), {}
    for name, place in places(first).items():
        if name != "palm_pose":
            axes[place.text.strip("`")] = first.dimensions(name)[-len(place.shape) :] if place.shape else ()
    for split, grasps in splits.items():
        root, rows, held, ends = zarr.create_group(folder / f"{split}.zarr", zarr_format=2), [], 0, []
        texts: dict[str, list] = {"grasps/object": [], "data/sub_task_instruction": []}
        for number, item in enumerate(with_progress(grasps, split), start=1):
            length = len(item[of_frames[0]]) if of_frames else 1
            constant = {path: np.repeat(value[None], length, axis=0) for path, value in same.items()}
            rows.append(_by_path(item, of_frames, length) | constant | {"data/timestamps": np.arange(length)})
            held, ends = held + length, [*ends, length]
            texts["grasps/object"].append(item["object"])
            texts["data/sub_task_instruction"] += [f"grasp the {item['class']}"] * length
            if held >= HELD or number == len(grasps):
                _append(root, {path: np.concatenate([row[path] for row in rows]) for path in rows[0]}, axes)
                rows, held = [], 0
        texts |= {"meta/episode_ends": np.cumsum(ends)}
        _append(root, {path: np.array(values) for path, values in texts.items()}, axes)


def places(grasps: GraspDataset) -> dict[str, Place]:
    """The path of each array in a split's store, and its axes there after that of episodes or frames."""
    of_frames, item, found = _of_frames(grasps), grasps[0], {}
    for name in grasps.sources:
        per_frame = name in of_frames
        if of_frames and name == "frames_occluded":  # which the layout has a name for if every frame has an image
            per_frame = len(item[name]) == len(item[of_frames[0]])
        own = name.removeprefix("frames_") if of_frames else name
        first_only = "camera" in grasps.dimensions(name)  # the layout has one camera
        label = NAMES.get(own) if not first_only and (per_frame or not of_frames or name == "palm_pose") else None
        path = f"data/{label}" if label else f"frames/{own}" if per_frame else f"grasps/{name}"
        shape = (6,) if name == "palm_pose" else item[name].shape[per_frame:]
        found[name] = Place(f"`{path}`", f"*.zarr/{path}/**", shape)
    return found


def _of_frames(grasps: GraspDataset) -> list[str]:
    """Names of the arrays with a row a frame."""
    return [name for name, (_, spec) in grasps.sources.items() if spec.shape[2:3] == ("f",)]


def _of_sensors(stated: Mapping) -> dict[str, np.ndarray]:
    """Kind, type and functional areas of the sensors of `sensor.json`, by their paths in the store."""
    names = stated["names"]
    areas = [0, 1] if len(names) == 2 else [AREAS.get(name) for name in names]
    if None in areas:
        known = ", ".join(AREAS)
        raise ValueError(f"Open-X-Tactile has areas of {known}, but the hand's sensors are called {', '.join(names)}")
    values = {"sensor": stated["sensor"]["name"], "type": "image", "area": areas}
    return {f"data/{TACTILE}_{key}_fingers": np.array(value) for key, value in values.items()}


def _by_path(item: dict[str, np.ndarray], of_frames: Sequence[str], length: int) -> dict[str, np.ndarray]:
    """A grasp's arrays in the layout's forms by their paths in the store, (t, ...) or for the grasp (1, ...).

    of_frames: names of those with a row a frame, of which there are `length`; without any, the grasp is the frame.
    """
    rest = {
        name: np.asarray(values)[None] for name, values in item.items() if name not in TEXT and name not in of_frames
    }
    frames = {name.removeprefix("frames_"): item[name] for name in of_frames}
    if not of_frames:
        frames = {name: rest.pop(name) for name in ("occluded", "reading") if name in rest}
    elif len(item.get("frames_occluded", ())) == length:
        frames["occluded"] = rest.pop("frames_occluded")[0]
    found = {f"data/{NAMES[name]}" if name in NAMES else f"frames/{name}": each for name, each in frames.items()}
    if "occluded" in frames and frames["occluded"].ndim == 5:  # of several cameras
        several = "frames/occluded" if of_frames else "grasps/occluded"
        found |= {f"data/{NAMES['occluded']}": frames["occluded"][:, 0], several: frames["occluded"]}
    if "palm_pose" in rest:
        pose = rest.pop("palm_pose")[0]
        wrist = np.append(pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_rotvec())
        found[f"data/{NAMES['palm_pose']}"] = np.tile(wrist, (length, 1))
    return found | {f"grasps/{name}": values for name, values in rest.items()}


def _append(root: zarr.Group, arrays: Mapping[str, np.ndarray], axes: Mapping[str, Sequence[str]]) -> None:
    """Append arrays (t, ...), which are made where they are not there; axes: names of further axes, for xarray."""
    for path, values in arrays.items():
        if path not in root:
            shape, codec = values.shape[1:], numcodecs.Blosc("zstd", 1, numcodecs.Blosc.SHUFFLE)
            stated = {"shape": (0, *shape), "chunks": (FRAMES, *shape), "fill_value": None}  # else xarray masks zeros
            array = root.create_array(path, dtype=values.dtype, compressors=codec, **stated)
            others = axes.get(path) or [f"{array.basename}_{axis}" for axis in range(1, values.ndim)]
            array.attrs["_ARRAY_DIMENSIONS"] = ["frame" if path.startswith(("data", "frames")) else "episode", *others]
        with zarr.config.set({"array.write_empty_chunks": True}):  # nothing says what a missing one holds
            root[path].append(values)
