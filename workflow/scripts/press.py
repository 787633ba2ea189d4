"""A touch sensor pressed onto surface points of a batch's objects. Arrays: palpate/store/contract.csv.

press/<batch>.zarr, rejected/press/<batch>.csv
"""

from workflow.run.job import log_to

import logging
from pathlib import Path

import numpy as np

from palpate import mesh, seal, store, touch
from palpate.batch import each_object, generator
from palpate.sensor import Sensor, read_background

log_to(snakemake.log[0])
meshes, params = Path(snakemake.input.meshes), snakemake.params
seed, description, settings = params.seed, params.sensor, params.press
surface = store.open(snakemake.input.surface)
made_with = {"seed": seed, "press": settings, "touch": {"sensor": description}}
made_from = seal.combine(made_with, seal.read(meshes), surface.seal)
image = snakemake.input.background
sensor = Sensor.from_description(description, read_background(image, description["resolution"]) if image else None)
points = dict(zip(surface["object"], surface["points"], strict=True))


def press(name: str) -> dict[str, np.ndarray]:
    geometry, draw = mesh.load_geometry(meshes / name), generator(seed, name, "press")
    arrays, discarded = touch.press_object(geometry, points[name] - mesh.OBJECT_POSITION, sensor, draw, **settings)
    for place in ("point", "position"):
        arrays[place] = arrays[place] + mesh.OBJECT_POSITION
    for reason, number in discarded.items():
        logging.info("%s: %d points without a press: %s", name, number, reason)
    touch.warn_of_strain(name, arrays["strain"])
    return arrays


presses = each_object(points, press, "press")
more = {"empty_reading": touch.shade_pressed(np.zeros(sensor.resolution), sensor)}
store.write_batch(snakemake.output, "press", presses, seed, made_from, more, {"sensor": description})
