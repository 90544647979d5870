"""Device of a training: the GPU if there is one, else the CPU."""

import os
from importlib.util import find_spec

import torch

from imaging.compute.threads import thread_count

CPU = torch.device("cpu")


def training_device() -> torch.device:
    """The CUDA device of this process, if torch sees one and Triton is there to program it; else the CPU."""
    if torch.cuda.is_available() and find_spec("triton") is not None:
        return torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))
    return CPU


def gpus() -> list[str]:
    """List the GPUs for training, each as CUDA_VISIBLE_DEVICES names it alone; empty without any."""
    if training_device().type != "cuda":
        return []
    named = os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",")
    return named if all(named) else [str(number) for number in range(torch.cuda.device_count())]


def device_name(device: torch.device) -> str:
    """Display name: the GPU's, or the number of CPU threads."""
    if device.type == "cuda":
        return str(torch.cuda.get_device_name(device))
    count = thread_count()
    return f"CPU, {count} thread{'s' if count > 1 else ''}"
