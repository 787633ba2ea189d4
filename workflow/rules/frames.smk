# Closing hands, if the config asks for them: the frames of every grasp.
rule frames:
    input:
        meshes="meshes/{batch}",
        surface="surface/{batch}.zarr",
        grasps="grasps/{batch}.h5",
        background=SENSOR_BACKGROUND,
    output:
        frames=directory("frames/{batch}.zarr"),
    log:
        "logs/frames/{batch}.log",
    benchmark:
        "benchmarks/frames/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        frames=lambda wildcards: {key: asked("frames", "count")[key] for key in ("count", "touch", "contacts")},
        grasps=config["grasps"],
        hold=GRASPS_HOLD,
        sensor=SENSOR.description(),
        seed=config["seed"],
    script:
        "../scripts/frames.py"
