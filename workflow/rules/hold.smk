# Whether hands keep their objects, if the config asks for it.
rule hold:
    input:
        meshes="meshes/{batch}",
        surface="surface/{batch}.zarr",
        grasps="grasps/{batch}.h5",
    output:
        hold=directory("hold/{batch}.zarr"),
    log:
        "logs/hold/{batch}.log",
    benchmark:
        "benchmarks/hold/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        hold=lambda wildcards: {key: value for key, value in asked("hold", "test").items() if key != "test"},
        grasps=config["grasps"],
        sensor=SENSOR.geometry,
        seed=config["seed"],
    script:
        "../scripts/hold.py"
