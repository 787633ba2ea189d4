# Points on the exterior surface of every object.
rule surface:
    input:
        meshes="meshes/{batch}",
    output:
        surface=directory("surface/{batch}.zarr"),
        rejected="rejected/surface/{batch}.csv",
    log:
        "logs/surface/{batch}.log",
    benchmark:
        "benchmarks/surface/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        objects=batch_objects,
        surface=config["surface"],
        seed=config["seed"],
    script:
        "../scripts/surface.py"
