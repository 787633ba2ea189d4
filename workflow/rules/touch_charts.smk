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


# Touch charts of a batch: depth that the U-Net predicts, and a chart fitted to it, for every touch.
rule charts:
    input:
        touch="touch/{batch}.zarr",
        model="models/touch_depth/best.ckpt",
    output:
        charts=directory("charts/{batch}.zarr"),
    log:
        "logs/charts/{batch}.log",
    benchmark:
        "benchmarks/charts/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    threads: config["training"]["threads"]
    resources:
        runtime=120,
        gpu=TRAINING_GPUS,
    params:
        touch_depth=RECIPE.touch_depth.row(),
        device=config["training"]["device"],
        seed=config["seed"],
    script:
        "../scripts/charts.py"
