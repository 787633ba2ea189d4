"""Cameras, lights and background of a config, to be looked at before a run: one object as every camera sees it.

    python -m palpate.results.camera_sheet results/default bottle-0007 --configfile mine.yaml --output cameras.png

The run's meshes are needed, and for the hand its grasps; its images are not.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image as PillowImage

from palpate.vision import blender

blender.load()

from palpate import scene, store  # noqa: E402  (Blender comes before embree)
from palpate.catalogue import CatalogueError  # noqa: E402
from palpate.configuration import ConfigError  # noqa: E402
from palpate.dataset import Dataset  # noqa: E402
from palpate.hand import Hand  # noqa: E402
from palpate.results.shapes_sheet import GAP  # noqa: E402
from palpate.store import StoreError  # noqa: E402
from palpate.vision import Renderer  # noqa: E402


def camera_sheet(run: Path | str, name: str, settings: Mapping[str, Any], path: Path | str, threads: int = 1) -> None:
    """Draw an object, a column a camera: alone, and below in its first grasp if the run has grasps.

    settings: the config's section `vision`, checked. path: of the picture. Raises ConfigError for cameras and lights
    that are not determined, KeyError for an object that the run does not have, and what the renderer raises.
    """
    run = Path(run)
    cameras, look = scene.cameras(settings), {key: getattr(scene, key)(settings) for key in ("lights", "background")}
    record = Dataset(run, ["meshes"])[name]
    made = scene.Scene(record.mesh, **look)
    grasps = run / store.CONTRACT["grasps"].path(record.batch)
    if grasps.exists():
        arrays = store.read(grasps)
        row = arrays["object"].tolist().index(name)
        first = {key: arrays[key][row, :1] for key in scene.GRASP_ARRAYS}
        made = scene.Scene.from_grasps(record.mesh, first, Hand.from_arrays(arrays, prefix="hand/"), **look)
    pictures = Renderer(settings["samples"], settings["device"], threads).render_cameras(made, cameras)
    columns = [np.concatenate([_framed(image.rgb) for image in (alone, *held)]) for alone, held in pictures]
    PillowImage.fromarray(np.concatenate(columns, axis=1)).save(path, optimize=True)


def _framed(rgb: np.ndarray) -> np.ndarray:
    """A picture with a white or, if it has opacity, transparent margin."""
    value = 255 if rgb.shape[2] == 3 else 0
    return np.pad(rgb, ((0, GAP), (0, GAP), (0, 0)), constant_values=value)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m palpate.results.camera_sheet",
        description="Draw an object of a run as the cameras of a config see it, by its lights.",
    )
    parser.add_argument("run", type=Path, help="the run's folder, for example results/default")
    parser.add_argument("object", help="its name in catalogue.csv, for example bottle-0007")
    parser.add_argument(
        "--configfile", type=Path, nargs="*", default=[], help="overlays on the run's config.yaml; their key `vision`"
    )
    parser.add_argument("--output", type=Path, required=True, help="the picture, .png")
    asked = parser.parse_args(arguments)
    try:
        settings: dict[str, Any] = {}
        for file in (asked.run / "config.yaml", *asked.configfile):
            settings |= (yaml.safe_load(file.read_text(encoding="utf-8")) or {}).get("vision", {})
        camera_sheet(asked.run, asked.object, settings, asked.output)
    except (CatalogueError, ConfigError, StoreError, KeyError, OSError) as error:
        print(error.args[0] if isinstance(error, KeyError) else error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
