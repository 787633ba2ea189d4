"""Networks: the U-Net of touch readings, the reconstruction by deformed charts, and what it is compared with."""

from palpate.models.reconstruction import Reconstruction
from palpate.models.single_image import SINGLE_IMAGE_MODELS, SingleImageModel
from palpate.models.touch_depth import TouchDepth

__all__ = ["SINGLE_IMAGE_MODELS", "Reconstruction", "SingleImageModel", "TouchDepth"]
