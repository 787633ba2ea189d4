# What a training or evaluation of an experiment reads.
from palpate.learning import inputs


def require_grasps(experiments):
    """Too few grasps for an experiment are an error before anything runs."""
    known = config["grasps"]["per_object"]
    for each in experiments:
        if each.grasps > known and not each.fewer_grasps:
            stop(f"experiment {each.name} takes {each.grasps} grasps, but grasps.per_object is {known}: raise it")


def stores_of(experiments, *more, training=False):
    """The catalogue, and the stores of all batches, of the stages that experiments take arrays of, and of more.

    Too few grasps for an experiment, or no object in a split, is an error before anything runs.
    """
    require_grasps(experiments)
    needed = dict.fromkeys([stage for each in experiments for stage in inputs.stages(each, training)] + [*more])
    return {
        "catalogue": catalogue_with(("train", "validation"), f"experiment {experiments[0].name}"),
        **{stage: expand(f"{stage}/{{batch}}.zarr", batch=BATCHES) for stage in needed},
    }


def trained_model(wildcards):
    """The files of a model that is evaluated; none in retrieval, which is not trained."""
    if not EXPERIMENTS.experiments[wildcards.experiment].is_trained:
        return {}
    folder = f"models/{wildcards.experiment}/seed-{wildcards.seed}"
    return {"model": f"{folder}/best.ckpt", "summary": f"{folder}/training.json"}


def evaluated(wildcards):
    """The experiments that are evaluated with a trained model: those of tables, or that model's own."""
    own, *others = EXPERIMENTS.of_weights(wildcards.experiment)
    return [each for each in (own, *others) if each.name in COMPARED and each.name in FEASIBLE] or [own]


def evaluated_in_rings(wildcards):
    claimed = experiments_of("claims", rings=True) if is_available("claims") else ()
    chosen = {*EXPERIMENTS.tables["extrapolation"].by_name, *claimed}
    return [each for each in evaluated(wildcards) if each.name in chosen]


def evaluated_with_choice(wildcards):
    chosen = EXPERIMENTS.tables["grasp_selection"].by_name
    return [each for each in EXPERIMENTS.of_weights(wildcards.experiment) if each.name in chosen]
