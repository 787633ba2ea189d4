"""Charts: atlas, graph, points on faces, distance between clouds, and fits to clouds. Needs torch."""

from palpate.charts.atlas import ATLAS_RADIUS, chart_faces, sphere, touch_chart, vision_atlas
from palpate.charts.chamfer import build_tree, chamfer_distance, nearest, one_sided_distance, plane_normals
from palpate.charts.fit import fit_atlas, fit_direct
from palpate.charts.graph import Graph
from palpate.charts.sample import face_areas, sample_faces

__all__ = [
    "ATLAS_RADIUS",
    "Graph",
    "build_tree",
    "chamfer_distance",
    "chart_faces",
    "face_areas",
    "fit_atlas",
    "fit_direct",
    "nearest",
    "one_sided_distance",
    "plane_normals",
    "sample_faces",
    "sphere",
    "touch_chart",
    "vision_atlas",
]
