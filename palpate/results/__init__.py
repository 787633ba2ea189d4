"""Results of a run: tables and figures of its dataset and its models, and the verdict on each of the paper's claims.

Each module is imported by its own name, because each brings its own engine: tables need pandas only,
`dataset_figures` embree and matplotlib, `atlas` torch, `grasp_steps` Blender, which must be imported first,
`reconstructions` and `local_predictions` Blender and torch.
"""
