# Tables and figures: each is a function of palpate/results, which declares what it reads (palpate/results/products.py).
from palpate import stages
from palpate.results import products, published

TABLE_FORMS = ["csv", "md", "tex"]
# What the fields in names of products stand for: the run's classes by their names in files, the paper's models.
FIELDS = {
    "class_name": {catalogue.file_name(name): name for name in CLASS_COUNTS},
    "model": {row["model"]: row["model"] for row in published.paper_rows("architectures")},
}
# Experiments that take at most the grasps that the run has, and the differences between them.
FEASIBLE = [each.name for each in EXPERIMENTS.experiments.values() if each.grasps <= config["grasps"]["per_object"]]
EFFECTS = published.effects(FEASIBLE)

COMPARISONS = list(dict.fromkeys(each.comparison for each in products.products() if each.comparison))
for name in EXPERIMENTS.tables:
    if name not in COMPARISONS:
        stop(f"config/experiments.yaml: no table is called {name}; there are {', '.join(COMPARISONS)}")


def is_available(source):
    """Whether the run has a source of evaluations. A released dataset has no views, which single images are of."""
    tables = EXPERIMENTS.tables
    if source == "effects":
        return bool(EFFECTS)
    if source == "retrieval":
        return not all(EXPERIMENTS.experiments[name].is_trained for name in experiments_of(source))
    if source == "claims":
        defined = set(published.published_experiments()) <= set(EXPERIMENTS.experiments)
        return defined and "extrapolation" in tables and tables["extrapolation"].split == "test"
    if source in tables:
        return not (RELEASED and any(each.vision == "views" for each in tables[source].by_name.values()))
    return not source


def experiments_of(source, rings=False):
    """Names of the experiments of a source; a source or an experiment that is not defined is an error."""
    if source == "claims":
        names = published.claimed_experiments(FEASIBLE, *["extrapolation"] * rings)
    elif source == "effects":
        names = sorted({row[key] for row in EFFECTS for key in ("experiment", "compared_with")})
    elif source == "retrieval":
        members = [EXPERIMENTS.tables[name] for name in ("input_modalities", "grasps") if name in EXPERIMENTS.tables]
        names = dict.fromkeys(name for table in members if table.split == "test" for name in table.by_name)
    elif source in EXPERIMENTS.tables:
        names = EXPERIMENTS.tables[source].by_name
    else:
        stop(f"config/experiments.yaml defines no table {source}")
    for name in names:
        if name not in EXPERIMENTS.experiments:
            stop(f"experiment {name} is needed, but config/experiments.yaml does not define it")
    # A released dataset has no masks.
    return [name for name in names if not (RELEASED and EXPERIMENTS.experiments[name].takes_masks)]


def trained(names):
    """The trained models that experiments are evaluated with."""
    return list(dict.fromkeys(EXPERIMENTS.experiments[name].trained for name in names))


def evaluations_of(names, folder="evaluations"):
    """The evaluation files of experiments: with each seed, but for what is not trained, which is measured once."""
    seeds = config["training"]["seeds"]
    return [
        f"{folder}/{name}/seed-{seed}.csv"
        for name in trained(names)
        for seed in (seeds if EXPERIMENTS.experiments[name].is_trained else seeds[:1])
    ]


def product_files(product):
    names = expand(product.name, **FIELDS)
    forms = TABLE_FORMS if product.kind == "tables" else product.form
    return expand(f"{product.kind}/{{name}}.{{form}}", name=names, form=forms)


def product_names(kind, chosen, form="png"):
    mine = [each for each in chosen if (each.kind, each.form) == (kind, form)]
    return [name for each in mine for name in expand(each.name, **FIELDS)]


def is_asked(product):
    """Whether the config asks for the stores that a product reads."""
    return all(stages.STAGES[each].is_asked(config) for each in product.stores)


# What the config allows to ask for, and what `dataset` and `all` make of it.
PRODUCTS = [each for each in products.products() if is_asked(each) and not (RELEASED and each.simulated)]
OFFERED = [each for each in PRODUCTS if all(map(is_available, (each.evaluations, each.rings, each.selections)))]
MADE = [each for each in OFFERED if not each.on_request and (each.kind == "tables" or config["figures"])]
SOURCES = dict.fromkeys(source for each in MADE for source in (each.evaluations, each.rings) if source)
COMPARED = {name for source in SOURCES for name in experiments_of(source)}
EVERY_SEED = {"seed": config["training"]["seeds"]}
FILES = {
    "touches": "evaluations/touch_depth.csv",
    "touch_depth": "models/touch_depth/best.ckpt",
    "trainings": expand("tuning/{point}/training.json", point=POINTS),
}


def kind_and_name(wildcards):
    """`tables`, `figures` or `reports`, and the name of the one that is asked for."""
    ((kind, name),) = wildcards.items()
    return f"{kind}s", name


def product_inputs(wildcards):
    """The files that a table or figure reads. That the run lacks a split is an error before anything runs."""
    kind, name = kind_and_name(wildcards)
    product, fields = products.find(kind, name)
    files = {each: FILES[each] for each in product.files}
    # A figure of a class reads the batches that have objects of it.
    classes = {FIELDS["class_name"][fields["class_name"]]} if "class_name" in fields else {*CLASS_COUNTS}
    batches = [each for each in BATCHES if classes & {entry.class_name for entry in BATCH_ENTRIES[each]}]
    if product.stores:
        rejecting = ["released"] if RELEASED else [each for each in product.stores if stages.STAGES[each].rejects]
        files["catalogue"] = "catalogue.csv"
        files["rejected"] = expand("rejected/{stage}/{batch}.csv", stage=rejecting, batch=batches)
    for stage in map(stages.STAGES.get, product.stores):
        if not (RELEASED and stage.simulated):
            files[stage.name] = expand(stage.path(), batch=batches)
    if product.models:
        models = trained(each for each in product.models if each in FEASIBLE)
        seed = config["training"]["seeds"][0]
        files["models"] = expand("models/{experiment}/seed-{seed}/best.ckpt", experiment=models, seed=seed)
    folders = {"evaluations": "evaluations", "rings": "evaluations/rings", "selections": "evaluations/selection"}
    for each, folder in folders.items():
        if source := getattr(product, each):
            measured = experiments_of(source, each == "rings")
            require_grasps(EXPERIMENTS.experiments[name] for name in measured)
            files[each] = evaluations_of(measured, folder)
    catalogue_with(product.needed_splits(EXPERIMENTS.tables), f"{kind[:-1]} {name}")
    return files


def product_category(wildcards):
    return products.find(*kind_and_name(wildcards))[0].category


def product_params(wildcards):
    """The values that its function takes of the config."""
    product, fields = products.find(*kind_and_name(wildcards))
    comparison = EXPERIMENTS.tables.get(product.comparison)
    source = comparison.name if comparison else product.evaluations
    compared = {each: EXPERIMENTS.experiments[each] for each in (experiments_of(source) if source else ())}
    values = {
        "experiments": {each: experiment.row() for each, experiment in compared.items()},
        "split": next(iter(product.needed_splits(EXPERIMENTS.tables)), None),
        "resamples": config["evaluation"]["resamples"],
        "points": list(POINTS.values()),
        "samples": config["vision"]["samples"],
    }
    values |= {field: FIELDS[field][value] for field, value in fields.items()}
    return {key: value for key, value in values.items() if key in product.parameters}


def caption(wildcards, output):
    """As reStructuredText. It takes `output`, since Snakemake makes nothing again for a change of such a param."""
    return products.caption(*kind_and_name(wildcards)).replace("`", "``")
