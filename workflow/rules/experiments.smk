# What config/experiments.yaml means for the workflow: its tables, checked, and the evaluations that each needs.
from palpate.results.published import published_experiments

# The tables of models that config/experiments.yaml may define, each by its list of experiments and its split.
EXPERIMENT_TABLES = (
    "model_selection",
    "input_modalities",
    "grasps",
    "extrapolation",
    "single_image",
)
# The models whose layers the paper tells (supplement, tables of architectures).
ARCHITECTURES = (
    "touch_depth",
    "occluded_touch",
    "occluded",
    "unoccluded_touch",
    "unoccluded",
    "touch",
    "single_image",
)

for name, table in EXPERIMENTS["tables"].items():
    if name not in EXPERIMENT_TABLES:
        raise WorkflowError(
            f"config/experiments.yaml: no table is called {name}; there are {', '.join(EXPERIMENT_TABLES)}"
        )
    if table["split"] == "train":
        raise WorkflowError(
            f"config/experiments.yaml: table {name}: models are measured on validation or test"
        )
    for experiment in table["experiments"]:
        if experiment not in EXPERIMENTS["experiments"]:
            raise WorkflowError(
                f"config/experiments.yaml: table {name} has experiment {experiment}, which is not defined"
            )


def evaluations_of(names, folder="evaluations"):
    """The evaluations of experiments with every seed; an experiment that is not defined is an error."""
    for name in names:
        if name not in EXPERIMENTS["experiments"]:
            raise WorkflowError(
                f"experiment {name} is needed, but config/experiments.yaml does not define it"
            )
    return expand(
        f"{folder}/{{experiment}}/seed-{{seed}}.csv",
        experiment=names,
        seed=config["training"]["seeds"],
    )


def table_setup(table):
    """The experiments of a table as they are defined, and its split; one that is not defined is an error."""
    if table not in EXPERIMENTS["tables"]:
        raise WorkflowError(f"config/experiments.yaml defines no table {table}")
    declared = EXPERIMENTS["tables"][table]
    return {
        "experiments": {
            name: EXPERIMENTS["experiments"][name] for name in declared["experiments"]
        },
        "split": declared["split"],
        "resamples": config["evaluation"]["bootstrap"],
    }


def sees_views(table):
    """Whether a model of the table is shown views of an object."""
    return any(
        EXPERIMENTS["experiments"][name]["vision"] == "views"
        for name in EXPERIMENTS["tables"][table]["experiments"]
    )


def claims_decidable():
    """Whether all that the claims compare is defined, and rings are measured where they look."""
    rings = EXPERIMENTS["tables"].get("extrapolation", {"split": None})
    defined = set(published_experiments()) <= set(EXPERIMENTS["experiments"])
    return defined and rings["split"] == "test"
