@cache
def own_hand_files():
    from palpate.hand import model_files  # loads MuJoCo

    return [checked(str(path)) for path in model_files(PROJECT / HAND["mjcf"])]


def hand_files(wildcards):
    """Meshes and whatever else the model file of an own hand names."""
    return own_hand_files() if HAND else []


# The hand closes on every object, in MuJoCo.
rule grasps:
    input:
        meshes="meshes/{batch}",
        surface="surface/{batch}.zarr",
        hand=[PROJECT / HAND[key] for key in ("mjcf", "sensors")] if HAND else [],
        hand_files=hand_files,
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
        seed=config["seed"],
    script:
        "../scripts/grasps.py"
