# What grasps take of `hold`: nothing, if they are placed on the surface and only have to touch.
GRASPS_HOLD = {key: value for key, value in config["hold"].items() if key != "test"}
if (config["grasps"]["placement"], config["grasps"]["keep"]) == ("surface", "touches"):
    GRASPS_HOLD = {}


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
        hold=GRASPS_HOLD,
        sensor=SENSOR.geometry,
        pressed=config["touch"]["pressed"],
        seed=config["seed"],
    script:
        "../scripts/grasps.py"
