# The hand closes on every object, in MuJoCo.
rule grasps:
    input:
        meshes="meshes/{batch}",
        surface="surface/{batch}.zarr",
        hand=[local(path) for path in HAND or []],
        hand_files=[local(path) for path in HAND_FILES],
    output:
        grasps="grasps/{batch}.h5",
        rejected="rejected/grasps/{batch}.csv",
    log:
        "logs/grasps/{batch}.log",
    benchmark:
        "benchmarks/grasps/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        grasps=config["grasps"],
        sensor=SENSOR.geometry,
        pressed=config["touch"]["pressed"],
        seed=config["seed"],
    script:
        "../scripts/grasps.py"
