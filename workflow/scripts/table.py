"""tables/<table>.csv, and the same for reading as .md and .tex.

dataset_statistics        objects, splits, grasps, touches, % successful, by class
grasp_success             share of grasps with 0 to 4 successful touches
penetration               how deep the hand is in the object or in itself, mm
model_selection           Chamfer distance (m^2 x 9000) of twelve models by class
input_modalities          Chamfer distance with different inputs
grasps                    Chamfer distance with 1 to 5 grasps
extrapolation             error in square rings around each touch, m^2 and m^2 x 9000
single_image              reconstruction from single images, Pixel2Mesh's protocol
local_touch_charts        Chamfer distance (m^2 x 9000) of local predictions, by class
claims                    this run's verdict on each claim of the paper that a number decides
touch_effect              what touch, grasps, copying and communication change, on both splits, beside the paper's
touch_effect_by_class     the same for each class
surface_quality           angles between faces, torn charts and faces across the true surface, by input
tuning                    the grid of hyperparameters: the result of each of its points, the best first
architectures/<model>     layers of the live module beside the paper's
"""

import pandas as pd

from palpate import checksums
from palpate.batch import log_to
from palpate.evaluation import rows
from palpate.results.tables import write_table


def evaluations() -> pd.DataFrame:
    return rows.read(snakemake.input.evaluations)


def rings() -> pd.DataFrame:
    return rows.read(snakemake.input.rings, rows.RING_COLUMNS)


def touches() -> pd.DataFrame:
    return rows.read([snakemake.input.touches], rows.TOUCH_COLUMNS)


def table(name: str, settings: dict) -> pd.DataFrame:
    """A table by its name; imports just what that one needs."""
    match name.split("/"):
        case ["architectures", model]:
            from palpate.results.architectures import architecture_table

            return architecture_table(model)
        case ["tuning"]:
            from palpate.results import model_tables

            remedy = "remove it and train this point again"
            trained = [checksums.read_record(path, remedy) for path in snakemake.input.trainings]
            return model_tables.tuning(settings["points"], trained)
        case ["claims"]:
            from palpate.results import claims

            return claims.decide(evaluations(), rings(), touches(), **settings)
        case ["touch_effect" | "touch_effect_by_class"]:
            from palpate.results import effects

            return getattr(effects, name)(evaluations(), **settings)
        case ["dataset_statistics" | "grasp_success" | "penetration"]:
            from palpate.results import dataset_tables

            return getattr(dataset_tables, name)(dataset_tables.dataset_frames("."))
    from palpate.results import model_tables

    measured = {"extrapolation": rings, "local_touch_charts": touches}.get(name, evaluations)
    return getattr(model_tables, name)(measured(), **settings)


log_to(snakemake.log[0])
write_table(table(snakemake.wildcards.table, snakemake.params.settings), snakemake.output.table)
