"""Things to render."""

import numpy as np
import trimesh

from palpate.scene import Scene
from palpate.vision import paper_camera


def scene_of(path, hand=None, poses=(), size=256):
    """The scene of an object's file `<folder>/visual.glb`, seen by the paper's camera."""
    return Scene(path.parent, hand, np.asarray(poses), camera=paper_camera(size))


def painted(mesh, rgb, roughness=1.0):
    """The mesh with one material: a colour (sRGB-free, linear 0..1 as glTF has it) and no metal."""
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*rgb, 1.0], metallicFactor=0.0, roughnessFactor=roughness
    )
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    return mesh


def ball(centre, radius, subdivisions=3):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    mesh.apply_translation(centre)
    return mesh


def grasp_poses(hand):
    """(2, L, 4, 4) link poses of a hand in front of the object, fingers open and half closed."""
    palm = np.eye(4)
    normal, fingers = np.array([-1.0, 0, 0]), np.array([0, 0.6, 0.8])
    palm[:3, :3] = np.stack([normal, np.cross(fingers, normal), fingers], axis=1)
    palm[:3, 3] = 0.09, -0.05, 0.6
    return np.stack([hand.forward(palm, hand.open_joint_positions + bend) for bend in (0.0, 0.3)])
