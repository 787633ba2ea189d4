# Whether hands keep their objects, if the config asks for it.
def hold_settings(wildcards):
    """The params `hold`; its target in a run that does not ask for it is an error before anything runs."""
    if not config["hold"]["test"]:
        stop("the config asks for no test of grasps: set hold.test, as in --config 'hold={test: true}'")
    return {key: value for key, value in config["hold"].items() if key != "test"}


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
        hold=hold_settings,
        grasps=config["grasps"],
        sensor=SENSOR.geometry,
        seed=config["seed"],
    script:
        "../scripts/hold.py"
