"""Numbers that published evaluations fix. Importing them loads no torch, so that a table is made without it."""

from palpate.mesh import DIAGONAL

CHAMFER_SCALE = 9000  # from m^2 to the unit of the paper's tables (its published evaluation)
RINGS = (1, 2, 3, 4, 5)  # around a touch (section 5.3), `palpate.learning.rings`

# Single images are judged as in Mesh R-CNN's published evaluation with Pixel2Mesh's protocol: meshes are scaled
# by `PIXEL2MESH_SCALE`, distances squared and compared with tau = 1e-4 and 2 tau.
# From metres to Pixel2Mesh's unit of length: it scales ShapeNet's meshes, whose boxes have a diagonal of 1, by 0.57.
PIXEL2MESH_SCALE = 0.57 / DIAGONAL
TAU = 1e-4
# That protocol's tables print the Chamfer distance in thousandths (an F1 of 70 % at tau means distances
# squared of about 1e-4; the tables say 0.4).
PIXEL2MESH_CHAMFER = 1000.0


def pixel2mesh_chamfer(chamfer: float) -> float:
    """Pixel2Mesh's Chamfer distance, from the paper's (m^2 x 9000): at its scale, in thousandths."""
    return chamfer / CHAMFER_SCALE * PIXEL2MESH_SCALE**2 * PIXEL2MESH_CHAMFER
