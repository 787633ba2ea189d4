from palpate.results import products


# One trained model on every object of the splits that a table needs, for each experiment that has its weights.
rule evaluate:
    input:
        unpack(lambda wildcards: stores_of(evaluated(wildcards))),
        unpack(trained_model),
    output:
        table="evaluations/{experiment}/seed-{seed}.csv",
    log:
        "logs/evaluate/{experiment}-{seed}.log",
    benchmark:
        "benchmarks/evaluate/{experiment}-{seed}.tsv"
    conda:
        "../../envs/palpate.yaml"
    threads: config["training"]["threads"]
    resources:
        mem_mb=lambda wildcards, input: 2000 + 2 * stored_mb(input),
        runtime=240,
        gpu=min(TRAINING_GPUS, 1),
    params:
        experiments=lambda wildcards: [(each.name, each.row()) for each in evaluated(wildcards)],
        splits=lambda wildcards: {
            each.name: products.needed_splits(each, EXPERIMENTS.tables) for each in evaluated(wildcards)
        },
        points=config["evaluation"]["points"],
        device=config["training"]["device"],
    script:
        "../scripts/evaluate.py"


# The same on the true surface in rings around every touch of a split.
use rule evaluate as evaluate_rings with:
    input:
        unpack(lambda wildcards: stores_of(evaluated_in_rings(wildcards), "touch", "rings")),
        unpack(trained_model),
    output:
        table="evaluations/rings/{experiment}/seed-{seed}.csv",
    log:
        "logs/evaluate_rings/{experiment}-{seed}.log",
    benchmark:
        "benchmarks/evaluate_rings/{experiment}-{seed}.tsv"
    params:
        experiments=lambda wildcards: [(each.name, each.row()) for each in evaluated_in_rings(wildcards)],
        splits=lambda wildcards: {
            each.name: [EXPERIMENTS.tables["extrapolation"].split] for each in evaluated_in_rings(wildcards)
        },
        points=None,


# After each grasp that a strategy chooses among those stored; not part of `all`.
use rule evaluate as evaluate_selection with:
    input:
        unpack(lambda wildcards: stores_of(evaluated_with_choice(wildcards))),
        unpack(trained_model),
    output:
        table="evaluations/selection/{experiment}/seed-{seed}.csv",
    log:
        "logs/evaluate_selection/{experiment}-{seed}.log",
    benchmark:
        "benchmarks/evaluate_selection/{experiment}-{seed}.tsv"
    params:
        experiments=lambda wildcards: [(each.name, each.row()) for each in evaluated_with_choice(wildcards)],
        splits=lambda wildcards: {
            each.name: [EXPERIMENTS.tables["grasp_selection"].split] for each in evaluated_with_choice(wildcards)
        },


# The U-Net's clouds, and the charts fitted to them, at every touch of a split.
use rule evaluate as evaluate_touch with:
    input:
        model="models/touch_depth/best.ckpt",
        summary="models/touch_depth/training.json",
        catalogue="catalogue.csv",
        touch=expand("touch/{batch}.zarr", batch=BATCHES),
        charts=expand("charts/{batch}.zarr", batch=BATCHES),
    output:
        table="evaluations/touch_depth.csv",
    log:
        "logs/evaluate_touch.log",
    benchmark:
        "benchmarks/evaluate_touch.tsv"
    params:
        experiments=None,
        splits=list(products.find("tables", "local_touch_charts")[0].splits),
