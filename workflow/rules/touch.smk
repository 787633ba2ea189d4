# What the four sensors of every grasp read.
rule touch:
    input:
        meshes="meshes/{batch}",
        grasps="grasps/{batch}.h5",
    output:
        touch=directory("touch/{batch}.zarr"),
        rejected="rejected/touch/{batch}.csv",
    log:
        "logs/touch/{batch}.log",
    benchmark:
        "benchmarks/touch/{batch}.tsv"
    params:
        touch=config["touch"],
        seed=config["seed"],
    script:
        "../scripts/touch.py"
