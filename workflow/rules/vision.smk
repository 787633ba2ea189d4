# Images of every object, alone and in each grasp, rendered by Blender: one process a batch.
rule vision:
    input:
        meshes="meshes/{batch}",
        grasps="grasps/{batch}.h5",
    output:
        vision=directory("vision/{batch}.zarr"),
        masters=[directory("exr/{batch}")] if config["vision"]["exr"] else [],
        rejected="rejected/vision/{batch}.csv",
    log:
        "logs/vision/{batch}.log",
    benchmark:
        "benchmarks/vision/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    resources:
        mem_mb=lambda wildcards: 2000 + texture_mb(wildcards.batch),
        runtime=120,
    params:
        vision=config["vision"],
        seed=config["seed"],
    script:
        "../scripts/vision.py"
