# The authors' released dataset, read instead of simulated: surface, touch and vision of a batch.
rule released:
    input:
        sources=lambda wildcards: batch_sources(wildcards.batch),
        empty_reading=f"{SOURCE.path}/empty_gel.npy",
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
        "../../envs/palpate.yaml"
    params:
        objects=batch_objects,
        source=SOURCE.path,
        settings={
            "surface": {"points": config["surface"]["points"]},
            "grasps": {"per_object": config["grasps"]["per_object"]},
            "vision": {"size": config["vision"]["size"]},
        },
        seed=config["seed"],
    script:
        "../scripts/released.py"
