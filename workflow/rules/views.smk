# Small images of every object from all around, for single-image reconstruction: rendered, or Choy et al.'s own.
rule views:
    input:
        meshes="meshes/{batch}",
    output:
        views=directory("views/{batch}.zarr"),
        rejected="rejected/views/{batch}.csv",
    log:
        "logs/views/{batch}.log",
    benchmark:
        "benchmarks/views/{batch}.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=3000,
        runtime=60,
    params:
        objects=batch_objects,
        views=config["views"],
        # Relative paths are the project's.
        renderings=(
            str(PROJECT / config["views"]["renderings"])
            if config["views"]["renderings"]
            else None
        ),
        device=config["vision"]["device"],
        seed=config["seed"],
    script:
        "../scripts/views.py"
