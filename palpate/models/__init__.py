"""Networks: the U-Net of touch readings, and the reconstruction by deformed charts, with its baselines."""

from palpate.models.architectures import PAPER_ARCHITECTURES, paper_architecture
from palpate.models.encoder import ImageEncoder
from palpate.models.gcn import GraphNetwork, ZeroNeighbourLayer
from palpate.models.pooling import PerceptualPooling
from palpate.models.reconstruction import Reconstruction
from palpate.models.touch_depth import TouchDepth

__all__ = [
    "PAPER_ARCHITECTURES",
    "GraphNetwork",
    "ImageEncoder",
    "PerceptualPooling",
    "Reconstruction",
    "TouchDepth",
    "ZeroNeighbourLayer",
    "paper_architecture",
]
