# What a training or evaluation of an experiment reads, and its settings.
from palpate.inference import inputs


def stores_of(name, *more):
    """The catalogue, and the stores of all batches, of the stages that an experiment takes arrays of, and of more.

    Too few grasps for the experiment, or no object in a split, is an error before anything runs.
    """
    experiment = EXPERIMENTS.experiments[name]
    if experiment.grasps > config["grasps"]["per_object"] and not experiment.fewer_grasps:
        stop(
            f"experiment {name} takes {experiment.grasps} grasps, but the config's "
            f"grasps.per_object is {config['grasps']['per_object']}: raise it"
        )
    return {
        "catalogue": catalogue_with(("train", "validation"), f"experiment {name}"),
        **{
            stage: expand(f"{stage}/{{batch}}.zarr", batch=BATCHES)
            for stage in dict.fromkeys([*inputs.stages(experiment), *more])
        },
    }


def experiment_stores(wildcards):
    return stores_of(wildcards.experiment)


def training_inputs(wildcards):
    """The stores of an experiment, and the model that its training continues from."""
    experiment, seed = wildcards.experiment, wildcards.seed
    base = RECIPE.base(EXPERIMENTS.experiments[experiment])
    return stores_of(experiment) | ({"base": f"models/{base}/seed-{seed}/best.ckpt"} if base else {})


def ring_stores(wildcards):
    """The stores of an experiment, and the rings around the touches."""
    return stores_of(wildcards.experiment, "touch", "rings")


def experiment_settings(wildcards):
    """How an experiment is trained by the run's recipe."""
    return RECIPE.settings(EXPERIMENTS.experiments[wildcards.experiment]).row()
