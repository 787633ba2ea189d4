"""Reports on a run: its tables (`tables`), and its figures (the others).

Each is imported by its own name, because each brings its own engine: `tables` needs pandas only, `figures`
embree and matplotlib, `atlas` torch, `grasp_steps` and `shapes_sheet` Blender, which must be imported first,
`reconstructions` and `local_predictions` Blender and torch.
"""
