"""Reports on a run: its tables (`tables`), and its figures (`figures`, `grasp_steps`, `shapes_sheet`).

Each is imported by its own name, because each brings its own engine: `tables` needs pandas only, `figures`
embree and matplotlib, `grasp_steps` and `shapes_sheet` Blender, which must be imported first.
"""
