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
