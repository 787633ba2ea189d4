"""What a model is trained and run on. Lightning is not loaded here: it takes seconds, and only training needs it."""

from typing import NamedTuple

import torch


class Machine(NamedTuple):
    """What a model is trained on.

    device: `auto` (a GPU if there is one), `cpu` or `gpu`. devices: number of GPUs. precision: as Lightning names it;
    weights are kept in float32 or more, because in bfloat16 a position is good to a millimetre, and float16 ends at
    6e-8, above most gradients. threads: of the CPU.
    """

    device: str = "auto"
    devices: int = 1
    precision: str = "32-true"
    threads: int = 1

    def accelerator(self) -> str:
        """Lightning's name of the device. Raises ValueError if a GPU is asked for and there is none."""
        if self.device == "gpu" and not torch.cuda.is_available():
            raise ValueError("config training.device is gpu, but torch finds none: set it to auto or cpu")
        return "gpu" if self.device != "cpu" and torch.cuda.is_available() else "cpu"

    def torch_device(self) -> torch.device:
        """The device, for a model that runs without Lightning."""
        return torch.device("cuda" if self.accelerator() == "gpu" else "cpu")
