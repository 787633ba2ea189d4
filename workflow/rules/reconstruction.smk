from palpate.learning.recipes import tuning_grid

TUNED = EXPERIMENTS.experiments.get("charts_occluded_touch")
# The points of the grid by their folders, as Snakemake's Paramspace names them; that would load pandas.
GRID = tuning_grid(PROJECT / "config/tuning.yaml", config["tuning"]["grid"])
POINTS = {str(Path(*(f"{key}~{value}" for key, value in point.items()))): point for point in GRID}


# One model of config/experiments.yaml, from just the stores that it takes arrays of (palpate/learning/inputs.py).
rule reconstruction:
    input:
        unpack(lambda wildcards: stores_of([EXPERIMENTS.experiments[wildcards.experiment]], training=True)),
    output:
        model="models/{experiment}/seed-{seed}/best.ckpt",
        history="models/{experiment}/seed-{seed}/history.csv",
        summary="models/{experiment}/seed-{seed}/training.json",
    log:
        "logs/reconstruction/{experiment}-{seed}.log",
    benchmark:
        "benchmarks/reconstruction/{experiment}-{seed}.tsv"
    conda:
        "../../envs/palpate.yaml"
    threads: config["training"]["threads"]
    resources:
        mem_mb=lambda wildcards, input: 2000 + 4 * stored_mb(input),
        runtime=1440,
        gpu=TRAINING_GPUS,
    params:
        experiment=lambda wildcards: EXPERIMENTS.experiments[wildcards.experiment].row(),
        settings=lambda wildcards: RECIPE.settings(EXPERIMENTS.experiments[wildcards.experiment]).row(),
        machine=TRAINING_MACHINE,
        seed=lambda wildcards: int(wildcards.seed),
    script:
        "../scripts/train.py"


# One point of the supplement's grid of hyperparameters; not part of `all`.
use rule reconstruction as tuning_point with:
    input:
        unpack(lambda wildcards: stores_of([TUNED])),
    output:
        model="tuning/{point}/best.ckpt",
        history="tuning/{point}/history.csv",
        summary="tuning/{point}/training.json",
    log:
        "logs/tuning/{point}.log",
    benchmark:
        "benchmarks/tuning/{point}.tsv"
    wildcard_constraints:
        point="|".join(map(re.escape, POINTS)),
    params:
        experiment=TUNED and TUNED.row(),
        settings=lambda wildcards: RECIPE.settings(TUNED).row(),
        point=lambda wildcards: POINTS[wildcards.point],
        steps=config["tuning"]["steps"],
        seed=config["seed"],


# The U-Net from a touch reading to depth, trained on the successful touches of the train split.
use rule reconstruction as touch_depth with:
    input:
        catalogue=lambda wildcards: catalogue_with(("train", "validation"), "the model of touches"),
        touch=expand("touch/{batch}.zarr", batch=BATCHES),
    output:
        model="models/touch_depth/best.ckpt",
        history="models/touch_depth/history.csv",
        summary="models/touch_depth/training.json",
    log:
        "logs/touch_depth.log",
    benchmark:
        "benchmarks/touch_depth.tsv"
    resources:
        mem_mb=lambda wildcards, input: 2000 + 8 * stored_mb(input),
        runtime=720,
        gpu=TRAINING_GPUS,
    params:
        experiment=None,
        settings=RECIPE.touch_depth.row(),
        seed=config["seed"],
