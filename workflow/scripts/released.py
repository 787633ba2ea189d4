"""A batch of the authors' released dataset, in our stores.

surface/<batch>.zarr    points of the surface; drawn if the release has more
touch/<batch>.zarr      poses, readings, clouds, and the depth that the clouds give
vision/<batch>.zarr     images; without masks and depths, which the release does not have
rejected/released/<batch>.csv    object, stage, reason
"""

from workflow.run.job import log_to

import logging
from pathlib import Path

import numpy as np

from palpate import seal, store
from palpate.batch import each_object, generator, write_rejections
from palpate.released import arrays as released
from palpate.sensor import DIGIT

log_to(snakemake.log[0])
params = snakemake.params
root, settings = Path(params.source), params.settings
made_from = seal.combine({"seed": params.seed, **settings})


def read(name: str) -> dict[str, dict[str, np.ndarray]]:
    surface = root / params.objects[name]
    draw = generator(params.seed, name, "surface")
    return {
        "surface": released.read_surface(surface, settings["surface"]["points"], draw),
        "touch": released.read_touch(surface, settings["grasps"]["per_object"]),
        "vision": released.read_vision(surface, settings["grasps"]["per_object"], settings["vision"]["size"]),
    }


empty_reading = released.read_empty_reading(root)
found, rejections = each_object(params.objects, read, "released")
agreement = [released.orientation_agreement(records["touch"], empty_reading) for records in found.values()]
if agreement:
    same, turned = 100 * np.nanmean(agreement, axis=0)
    logging.info("readings lie on %.1f %% of their depths' pixels (%.1f %% if turned over)", same, turned)
    if turned > same:
        logging.warning("rows and columns of the readings look exchanged: the depths fit better turned over")
write_rejections(snakemake.output.rejected, rejections, made_from)
made_from = seal.with_output(made_from, snakemake.output.rejected)
for stage in ("surface", "touch", "vision"):
    arrays = store.join(stage, {name: records[stage] for name, records in found.items()})
    store.write(
        snakemake.output[stage],
        stage,
        arrays | ({"empty_reading": empty_reading} if stage == "touch" else {}),
        {"seed": params.seed, "made_from": made_from, "source": "released"}
        | ({"sensor": DIGIT.description()} if stage == "touch" else {}),
    )
