# Which tables, figures and reports there are, and just the files that each is made from.
from palpate.results.published import OF_EXPERIMENTS, effects, needed_splits, paper_values, published_experiments
from studies import items as report_items
from studies.subjects import round_robin

# Counted from the catalogue and the touch stores. The authors' dataset comes without the hand: no penetration is known.
DATASET_TABLES = ["dataset_statistics", "grasp_success", *([] if RELEASED else ["penetration"])]
# The tables that config/experiments.yaml may define, each by its list of experiments and its split.
EXPERIMENT_TABLES = [*OF_EXPERIMENTS, "single_image"]
# The models whose layers the paper tells (supplement, tables of architectures).
ARCHITECTURES = expand("architectures/{model}", model=paper_values("architectures")["model"].unique())
# That local predictions are measured on (section 5.3).
LOCAL_SPLIT = "test"
# The experiments of figures/reconstructions.png; its columns: palpate/results/reconstructions.py.
DRAWN = ["charts_occluded", "charts_occluded_touch", "charts_unoccluded", "charts_unoccluded_touch", "charts_touch"]
DRAWN += [f"charts_touch_{count}" for count in (2, 3, 4, 5)]

for name in EXPERIMENTS.tables:
    if name not in EXPERIMENT_TABLES:
        stop(f"config/experiments.yaml: no table is called {name}; there are {', '.join(EXPERIMENT_TABLES)}")


def seeds_of(names, path):
    """A file of each experiment with every seed; an experiment that is not defined is an error."""
    for name in names:
        if name not in EXPERIMENTS.experiments:
            stop(f"experiment {name} is needed, but config/experiments.yaml does not define it")
    return expand(path, experiment=names, seed=config["training"]["seeds"])


def evaluations_of(names):
    return seeds_of(names, "evaluations/{experiment}/seed-{seed}.csv")


def rings_of(names):
    return seeds_of(names, "evaluations/rings/{experiment}/seed-{seed}.csv")


def table_setup(table):
    """The experiments of a table as they are defined, and its split; a table that is not defined is an error."""
    if table not in EXPERIMENTS.tables:
        stop(f"config/experiments.yaml defines no table {table}")
    comparison = EXPERIMENTS.tables[table]
    return {
        "experiments": {experiment.name: experiment.row() for experiment in comparison.experiments},
        "split": comparison.split,
        "resamples": config["evaluation"]["resamples"],
    }


def is_made(table):
    """Whether a table of experiments is part of a run: a released dataset has no views, which single images are of."""
    return not (RELEASED and any(experiment.vision == "views" for experiment in EXPERIMENTS.tables[table].experiments))


def claims_decidable():
    """Whether all that the claims compare is defined, and rings are measured where they look."""
    rings = EXPERIMENTS.tables.get("extrapolation")
    return set(published_experiments()) <= set(EXPERIMENTS.experiments) and rings and rings.split == "test"


MADE = list(filter(is_made, EXPERIMENTS.tables))
# The differences of experiments that are defined and see no more grasps than the run has.
EFFECTS = effects(
    each.name for each in EXPERIMENTS.experiments.values() if each.grasps <= config["grasps"]["per_object"]
)
MODEL_TABLES = [*MADE, "local_touch_charts", *(["claims"] if claims_decidable() else [])]
MODEL_TABLES += ["touch_effect", "touch_effect_by_class"] if EFFECTS else []
MODEL_TABLES += ["surface_quality"] if "input_modalities" in MADE else []
TRAINED = sorted({name for table in MADE for name in table_setup(table)["experiments"]})
CLASS_FILES = {catalogue.file_name(name): name for name in CLASS_COUNTS}
# They show meshes and hands.
DATASET_FIGURES = [] if RELEASED else ["data_point", "grasp_steps", *expand("examples_{name}", name=CLASS_FILES)]
MODEL_FIGURES = ["training_curves", "reconstructions", "local_predictions", "atlas"]
MODEL_FIGURES += ["multi_grasp"] if "grasps" in EXPERIMENTS.tables else []
MODEL_FIGURES += ["error_over_rings"] if "extrapolation" in EXPERIMENTS.tables else []


def of_batches(*stages):
    """The stores of stages, of all batches. Of a source without meshes the surface points stand in for them."""
    suffix = {"meshes": "", "grasps": ".h5"}
    return {
        stage: expand(f"{stage}/{{batch}}{suffix.get(stage, '.zarr')}", batch=BATCHES)
        for stage in stages
        if not (RELEASED and stage in suffix)
    }


def table_inputs(wildcards):
    match wildcards.table:
        case "dataset_statistics" | "grasp_success" | "penetration":  # no renderer starts for them
            stages = [stage for stage in STAGES if stage != "vision"]
            rejected = expand("rejected/{stage}/{batch}.csv", stage=stages, batch=BATCHES)
            return {"catalogue": "catalogue.csv", "rejected": rejected, **of_batches("touch", "grasps")}
        case "extrapolation" as table:
            catalogue_with([table_setup(table)["split"]], f"table {table}")
            return {"rings": rings_of(table_setup(table)["experiments"])}
        case "local_touch_charts":
            catalogue_with([LOCAL_SPLIT], "table local_touch_charts")
            return {"touches": "evaluations/touch_depth.csv"}
        case "claims":
            catalogue_with(("validation", "test"), "table claims")
            return {
                "evaluations": evaluations_of(published_experiments()),
                "rings": rings_of(published_experiments("extrapolation")),
                "touches": "evaluations/touch_depth.csv",
            }
        case "touch_effect" | "touch_effect_by_class":
            names = sorted({row[key] for row in EFFECTS for key in ("experiment", "compared_with")})
            return {"evaluations": evaluations_of(names)}
        case "tuning":
            return {"trainings": expand("tuning/{point}/training.json", point=TUNING.instance_patterns)}
        case "surface_quality":
            return {"evaluations": evaluations_of(table_setup("input_modalities")["experiments"])}
        case table if table in ARCHITECTURES:  # read off the modules themselves
            return {}
        case table:
            catalogue_with([table_setup(table)["split"]], f"table {table}")
            return {"evaluations": evaluations_of(table_setup(table)["experiments"])}


def table_settings(wildcards):
    match wildcards.table:
        case "local_touch_charts":
            return {"split": LOCAL_SPLIT, "resamples": config["evaluation"]["resamples"]}
        case "claims" | "touch_effect" | "touch_effect_by_class":
            return {"resamples": config["evaluation"]["resamples"]}
        case "tuning":
            return {"points": TUNING.dataframe.to_dict("records")}
        case "surface_quality":
            return table_setup("input_modalities")
        case table if table in EXPERIMENT_TABLES:
            return table_setup(table)
        case _:
            return {}


def figure_inputs(wildcards):
    catalogue = {"catalogue": "catalogue.csv"}
    match wildcards.figure:
        case "multi_grasp":
            return {"evaluations": evaluations_of(table_setup("grasps")["experiments"])}
        case "error_over_rings":
            return {"rings": rings_of(table_setup("extrapolation")["experiments"])}
        case "training_curves":
            return {"histories": seeds_of(TRAINED, "models/{experiment}/seed-{seed}/history.csv")}
        case "local_predictions":
            return catalogue | of_batches("touch") | {"touch_depth": "models/touch_depth/best.ckpt"}
        case "reconstructions":
            models = expand(
                "models/{experiment}/seed-{seed}/best.ckpt", experiment=drawn(), seed=config["training"]["seeds"][0]
            )
            stores = of_batches("meshes", "surface", "touch", "vision")
            return catalogue | stores | {"touch_depth": "models/touch_depth/best.ckpt", "models": models}
        case "atlas":
            return {}
        case _:
            return {"stores": STORES, **of_batches("meshes")}


def drawn():
    """The experiments of figures/reconstructions.png that are defined and see no more grasps than the run has."""
    defined = EXPERIMENTS.experiments
    return [name for name in DRAWN if name in defined and defined[name].grasps <= config["grasps"]["per_object"]]


def figure_settings(wildcards):
    match wildcards.figure:
        case "multi_grasp":
            return table_setup("grasps")
        case "error_over_rings":
            return table_setup("extrapolation")
        case "training_curves":
            return {
                "trainings": [(name, seed) for name in TRAINED for seed in config["training"]["seeds"]],
                "experiments": {name: EXPERIMENTS.experiments[name].row() for name in TRAINED},
            }
        case "local_predictions" | "reconstructions":
            return {"fit": config["training"]["chart_fit"]}
        case figure if figure.startswith("examples_"):
            return {"class_name": CLASS_FILES[figure.removeprefix("examples_")]}
        case _:
            return {}


REPORT_OBJECTS = round_robin(ENTRIES, lambda entry: entry.class_name)[: config["reports"]["objects"]]
REPORT_BATCHES = sorted({PLACES[entry.object] for entry in REPORT_OBJECTS})


def report_item(wildcards):
    return report_items.REPORTS[wildcards.report][wildcards.item]


def report_inputs(wildcards):
    """What an item reads, of the batches that hold the report's objects."""
    files = {name: report_items.FILES[name] for name in report_item(wildcards).reads}
    files["catalogue"] = "catalogue/{batch}.csv"
    return {name: expand(paths, batch=REPORT_BATCHES, every_batch=BATCHES) for name, paths in sorted(files.items())}


def report_settings(wildcards):
    """The sections of the config that an item depends on."""
    return {section: RECIPE if section == "recipe" else config[section] for section in report_item(wildcards).settings}


def report_tables(report):
    """The tables of the items that `reports.stages` asks for."""
    asked = report_items.items_of_stages(report, config["reports"]["stages"])
    return expand(f"reports/{report}/{{item}}.csv", item=asked)


def timed(wildcards):
    """Whether an item measures times: then no other job runs beside it."""
    return wildcards.report in report_items.TIMED


def named_targets():
    """Rules that can be asked for; those named like files stand for paths from the project's root."""
    return [rule.name for rule in workflow.rules if not rule.has_wildcards() and rule.name.isidentifier()]


def known_targets():
    """The targets that there are: by name, and every file that is worth asking for."""
    tables = [*DATASET_TABLES, *MODEL_TABLES, "tuning", *ARCHITECTURES]
    of_models = {"experiment": EXPERIMENTS.experiments, "seed": config["training"]["seeds"]}
    return [
        *named_targets(),
        *expand("tables/{table}.{form}", table=tables, form=["csv", "md", "tex"]),
        *expand("figures/{figure}.png", figure=[*DATASET_FIGURES, *MODEL_FIGURES]),
        *expand("models/{experiment}/seed-{seed}/best.ckpt", **of_models),
        *expand("evaluations/{experiment}/seed-{seed}.csv", **of_models),
        *expand("evaluations/rings/{experiment}/seed-{seed}.csv", **of_models),
        *("catalogue.csv", "rejected.csv", "models/touch_depth/best.ckpt", "evaluations/touch_depth.csv"),
        *expand("reports/{report}.csv", report=["validation", *report_items.REPORTS]),
        *expand(
            "{store}/{batch}.zarr", store=["surface", "touch", "vision", "views", "charts", "rings"], batch=BATCHES
        ),
        *expand("meshes/{batch}", batch=BATCHES),
        *expand("grasps/{batch}.h5", batch=BATCHES),
    ]


def explain_target(path):
    """What to say of a target that nothing makes."""
    path = os.path.relpath(path, RUN_FOLDER) if os.path.isabs(path) else path
    known, seeds = known_targets(), config["training"]["seeds"]
    notes = [
        f"by name: {', '.join(sorted(named_targets()))}",
        f"tables/<table>.csv, .md, .tex: {', '.join([*DATASET_TABLES, *MODEL_TABLES, 'tuning', *ARCHITECTURES])}",
        f"figures/<figure>.png: {', '.join([*DATASET_FIGURES, *MODEL_FIGURES])}",
        f"models/<experiment>/seed-<seed>/best.ckpt, evaluations/<experiment>/seed-<seed>.csv: "
        f"{', '.join(EXPERIMENTS.experiments)}; seeds {', '.join(map(str, seeds))}",
        f"meshes/<batch>, <stage>/<batch>.zarr, grasps/<batch>.h5: {BATCHES[0]} to {BATCHES[-1]}",
    ]
    seed = re.search(r"\bseed-(\d+)\b", path)
    if seed and int(seed[1]) not in seeds:
        notes.insert(0, f"the config has no seed {seed[1]}: add it to training.seeds")
    return terminal.unknown_target(path, known, notes)
