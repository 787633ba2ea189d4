# What the sensors of every grasp read.
rule touch:
    input:
        meshes="meshes/{batch}",
        grasps="grasps/{batch}.h5",
        background=SENSOR_BACKGROUND,
    output:
        touch=directory("touch/{batch}.zarr"),
        rejected="rejected/touch/{batch}.csv",
    log:
        "logs/touch/{batch}.log",
    benchmark:
        "benchmarks/touch/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        sensor=SENSOR.description(),
        pressed=config["touch"]["pressed"],
        seed=config["seed"],
    script:
        "../scripts/touch.py"
