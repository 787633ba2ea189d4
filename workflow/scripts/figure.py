"""figures/<figure>.png

data_point                one grasp as the paper's dataset figure
examples_<class>          a sheet of a class's objects, their images, readings and touch sites
grasp_steps               the object; the hand as loaded, placed, and closed; rendered by Blender
multi_grasp               error with more grasps relative to one
error_over_rings          error at growing distances from a touch
training_curves           loss of every training against its run time
reconstructions           test objects as models of each modality and number of grasps see them; by Blender
local_predictions         readings, true and predicted clouds, and touch charts, at some touches; by Blender
atlas                     the vision charts before any deformation, slightly separated
"""

from pathlib import Path

from palpate import Dataset
from palpate.atomic import atomic_write
from palpate.batch import log_to


def draw(name: str, settings: dict, path: Path) -> None:
    """Draw a figure by its name; imports just what that one needs. Blender comes before what loads embree."""
    match name:
        case "grasp_steps":
            from palpate.results.grasp_steps import grasp_steps

            grasp_steps(Dataset("."), path, snakemake.threads)
        case "reconstructions":
            from palpate.results.reconstructions import STAGES, reconstructions

            models = {Path(model).parts[1]: model for model in snakemake.input.models}
            reconstructions(Dataset(".", STAGES), models, path, settings["fit"], snakemake.threads)
        case "local_predictions":
            from palpate.results.local_predictions import STAGES, local_predictions

            model = snakemake.input.touch_depth
            local_predictions(Dataset(".", STAGES), model, path, settings["fit"], snakemake.threads)
        case "atlas":
            from palpate.results import atlas

            atlas.draw(path)
        case "multi_grasp" | "error_over_rings" | "training_curves":
            from palpate.evaluation import rows
            from palpate.results import model_figures

            if name == "multi_grasp":
                model_figures.multi_grasp(rows.read(snakemake.input.evaluations), path=path, **settings)
            elif name == "error_over_rings":
                rings = rows.read(snakemake.input.rings, rows.RING_COLUMNS)
                model_figures.error_over_rings(rings, path=path, **settings)
            else:
                histories = dict(zip(map(tuple, settings["trainings"]), snakemake.input.histories, strict=True))
                model_figures.training_curves(histories, settings["experiments"], path)
        case _:
            from palpate.results import dataset_figures

            if name == "data_point":
                dataset_figures.data_point(Dataset("."), path)
            else:
                dataset_figures.examples(Dataset("."), settings["class_name"], path)


log_to(snakemake.log[0])
with atomic_write(snakemake.output.figure) as path:
    draw(snakemake.wildcards.figure, snakemake.params.settings, path)
