"""What a model is trained and run on."""

from typing import NamedTuple

import torch


class Machine(NamedTuple):
    """What a model is trained on."""

    device: str = "auto"  # a GPU if there is one; or `cpu`, `gpu`
    devices: int = 1  # number of GPUs
    precision: str = "32-true"  # or `bf16-mixed`: weights stay in float32, since in bfloat16 they are good to a mm
    threads: int = 1  # of the CPU

    def torch_device(self) -> torch.device:
        """`cpu` or `cuda`. Raises ValueError if a GPU is asked for and there is none."""
        if self.device == "gpu" and not torch.cuda.is_available():
            raise ValueError("config training.device is gpu, but torch finds none: set it to auto or cpu")
        return torch.device("cuda" if self.device != "cpu" and torch.cuda.is_available() else "cpu")
