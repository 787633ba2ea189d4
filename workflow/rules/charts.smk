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
        CONDA
    threads: config["training"]["threads"]
    resources:
        mem_mb=3000,
        runtime=120,
        gpu=TRAINING_GPUS,
    params:
        settings={
            "touch_charts": config["training"]["touch_charts"],
            "touch_depth": RECIPE["touch_depth"],
        },
        device=config["training"]["device"],
        seed=config["seed"],
    script:
        "../scripts/charts.py"
