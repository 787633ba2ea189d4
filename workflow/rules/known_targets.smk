# The targets that there are, for the message about one that no rule makes.
NAMED_TARGETS = ["all", "catalogue", "dataset", "rejected", *([] if RELEASED else ["reports"]), "smoke"]
NAMED_TARGETS += ["touch_depth", "validate", "validation"]


def known_targets():
    """The targets that there are: by name, and every file that is worth asking for."""
    models = [name for name in trained(EXPERIMENTS.experiments) if EXPERIMENTS.experiments[name].is_trained]
    return [
        *NAMED_TARGETS,
        *(path for product in OFFERED for path in product_files(product)),
        *expand("models/{experiment}/seed-{seed}/best.ckpt", experiment=models, **EVERY_SEED),
        *evaluations_of(EXPERIMENTS.experiments),
        *evaluations_of(EXPERIMENTS.experiments, "evaluations/rings"),
        *("catalogue.csv", "rejected.csv", "models/touch_depth/best.ckpt", "evaluations/touch_depth.csv"),
        *expand("reports/{report}.csv", report=["validation", *([] if RELEASED else report_items.REPORTS)]),
        *expand("rejected/{stage}/{batch}.csv", stage=STAGES, batch=BATCHES),
        *(path for stage in stages.STAGES.values() for path in expand(stage.path(), batch=BATCHES)),
    ]


def explain_target(path):
    """The message for an unknown target, with the nearest known ones and the kinds of targets, a line each."""
    path = os.path.relpath(path, RUN_FOLDER) if os.path.isabs(path) else path
    seeds = config["training"]["seeds"]
    notes = [
        f"by name: {', '.join(NAMED_TARGETS)}",
        f"tables/<table>.csv, .md, .tex: {', '.join(product_names('tables', OFFERED))}",
        f"figures/<figure>.png: {', '.join(product_names('figures', OFFERED))}",
        f"figures/<figure>.gif: {', '.join(product_names('figures', OFFERED, 'gif')) or 'of runs with frames'}",
        f"models/<experiment>/seed-<seed>/best.ckpt, evaluations/<experiment>/seed-<seed>.csv: "
        f"{', '.join(trained(EXPERIMENTS.experiments))}; seeds {', '.join(map(str, seeds))}",
        f"meshes/<batch>, <stage>/<batch>.zarr, grasps/<batch>.h5: {BATCHES[0]} to {BATCHES[-1]}",
    ]
    seed = re.search(r"\bseed-(\d+)\b", path)
    if seed and int(seed[1]) not in seeds:
        notes.insert(0, f"the config has no seed {seed[1]}: add it to training.seeds")
    return "\n  ".join([f"no target {path}{nearest(path, known_targets())}", *notes])
