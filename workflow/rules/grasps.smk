# The hand closes on every object, in MuJoCo.
rule grasps:
    input:
        meshes="meshes/{batch}",
        surface="surface/{batch}.zarr",
        hand=[PROJECT / path for path in (HAND or {}).values()],
    output:
        grasps="grasps/{batch}.h5",
        rejected="rejected/grasps/{batch}.csv",
    log:
        "logs/grasps/{batch}.log",
    benchmark:
        "benchmarks/grasps/{batch}.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=3000,
        runtime=60,
    params:
        grasps=config["grasps"],
        project=PROJECT,
        seed=config["seed"],
    script:
        "../scripts/grasps.py"
