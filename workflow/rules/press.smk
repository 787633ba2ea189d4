# A touch sensor pressed onto surface points, if the config asks for it.
rule press:
    input:
        meshes="meshes/{batch}",
        surface="surface/{batch}.zarr",
        background=SENSOR_BACKGROUND,
    output:
        press=directory("press/{batch}.zarr"),
        rejected="rejected/press/{batch}.csv",
    log:
        "logs/press/{batch}.log",
    benchmark:
        "benchmarks/press/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        press=lambda wildcards: asked("press", "count"),
        sensor=SENSOR.description(),
        seed=config["seed"],
    script:
        "../scripts/press.py"
