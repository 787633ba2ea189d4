# Small images of every object from all around, for single-image reconstruction.
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
        "../../envs/palpate.yaml"
    resources:
        mem_mb=lambda wildcards: 2000 + texture_mb(wildcards.batch),
    params:
        objects=batch_objects,
        views=config["views"],
        device=config["vision"]["device"],
        seed=config["seed"],
    script:
        "../scripts/views.py"
