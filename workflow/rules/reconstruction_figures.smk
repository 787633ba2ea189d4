# What models predict, rendered. Columns of figures/reconstructions.png: palpate/results/reconstructions.py.
DRAWN = [
    name
    for name in [
        "charts_occluded",
        "charts_occluded_touch",
        "charts_unoccluded",
        "charts_unoccluded_touch",
        "charts_touch",
        "charts_touch_2",
        "charts_touch_3",
        "charts_touch_4",
        "charts_touch_5",
    ]
    if name in EXPERIMENTS["experiments"]
    and EXPERIMENTS["experiments"][name]["grasps"] <= config["grasps"]["per_object"]
]

FIGURES += [
    "figures/reconstructions.png",
    "figures/local_predictions.png",
    "figures/atlas.png",
]


rule reconstructions:
    input:
        catalogue="catalogue.csv",
        # Of a source without meshes the surface points stand in for them.
        meshes=[] if RELEASED else expand("meshes/{batch}", batch=BATCHES),
        surface=expand("surface/{batch}.zarr", batch=BATCHES),
        touch=expand("touch/{batch}.zarr", batch=BATCHES),
        vision=expand("vision/{batch}.zarr", batch=BATCHES),
        touch_depth="models/touch_depth/best.ckpt",
        models=expand(
            "models/{experiment}/seed-{seed}/best.ckpt",
            experiment=DRAWN,
            seed=config["training"]["seeds"][0],
        ),
    output:
        figure=report(
            "figures/reconstructions.png",
            caption="../report/reconstructions.rst",
            category="Models",
        ),
    log:
        "logs/reconstructions.log",
    benchmark:
        "benchmarks/reconstructions.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=4000,
        runtime=30,
    params:
        fit=config["training"]["touch_charts"],
    script:
        "../scripts/reconstructions.py"


rule local_predictions:
    input:
        catalogue="catalogue.csv",
        touch=expand("touch/{batch}.zarr", batch=BATCHES),
        model="models/touch_depth/best.ckpt",
    output:
        figure=report(
            "figures/local_predictions.png",
            caption="../report/local_predictions.rst",
            category="Models",
        ),
    log:
        "logs/local_predictions.log",
    benchmark:
        "benchmarks/local_predictions.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=3000,
        runtime=10,
    params:
        fit=config["training"]["touch_charts"],
    script:
        "../scripts/local_predictions.py"


rule atlas:
    output:
        figure=report(
            "figures/atlas.png",
            caption="../report/atlas.rst",
            category="Models",
        ),
    log:
        "logs/atlas.log",
    benchmark:
        "benchmarks/atlas.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    script:
        "../scripts/atlas.py"
