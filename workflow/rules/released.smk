# The authors' released dataset, read instead of simulated: surface, touch and vision of a batch.
rule released:
    input:
        sources=batch_sources,
        empty_reading=f"{SOURCE['path']}/empty_gel.npy",
    output:
        surface=directory("surface/{batch}.zarr"),
        touch=directory("touch/{batch}.zarr"),
        vision=directory("vision/{batch}.zarr"),
        rejected="rejected/released/{batch}.csv",
    log:
        "logs/released/{batch}.log",
    benchmark:
        "benchmarks/released/{batch}.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        objects=batch_objects,
        source=SOURCE["path"],
        settings={
            "points": config["surface"]["points"],
            "grasps": config["grasps"]["per_object"],
            "size": config["vision"]["size"],
        },
        seed=config["seed"],
    script:
        "../scripts/released.py"
