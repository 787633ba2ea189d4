# Images of some frames of closing hands, if the config asks for them.
rule frame_images:
    input:
        meshes="meshes/{batch}",
        grasps="grasps/{batch}.h5",
        frames="frames/{batch}.zarr",
    output:
        frame_images=directory("frame_images/{batch}.zarr"),
        rejected="rejected/frame_images/{batch}.csv",
    log:
        "logs/frame_images/{batch}.log",
    benchmark:
        "benchmarks/frame_images/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    resources:
        mem_mb=lambda wildcards: 2000 + texture_mb(wildcards.batch),
        runtime=120,
    params:
        frames=lambda wildcards: {"images": asked("frames", "images")["images"]},
        vision=config["vision"],
        seed=config["seed"],
    script:
        "../scripts/frame_images.py"
