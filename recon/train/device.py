"""Where a training runs: on the GPU when there is one, else on the CPU."""

import os
from importlib.util import find_spec

import torch

from imaging.compute.threads import thread_count


def training_device() -> torch.device:
    """The CUDA device of this process, if torch sees one and Triton is there to program it; else the CPU."""
    if torch.cuda.is_available() and find_spec("triton") is not None:
        return torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))
    return torch.device("cpu")


def gpus() -> list[str]:
    """Those that trainings run on, each as CUDA_VISIBLE_DEVICES names it alone; none without any."""
    if training_device().type != "cuda":
        return []
    named = os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",")
    return named if all(named) else [str(number) for number in range(torch.cuda.device_count())]


def device_name(device: torch.device) -> str:
    """For people: the GPU's name, or how many threads of the CPU are used."""
    if device.type == "cuda":
        return str(torch.cuda.get_device_name(device))
    count = thread_count()
    return f"CPU, {count} thread{'s' if count > 1 else ''}"
