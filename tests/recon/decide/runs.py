"""Settings of small trainings, and runs that ask for them."""

import time

import torch

from imaging.progress import unreported
from recon.decide.evidence import Run
from recon.decide.settings import Settings
from recon.train.devices.ranks import Ranks


def settings(**changed) -> Settings:
    return Settings(
        **{"method": "nh-3dgs", "quality": "standard", "seed": 0, "iterations": 40, "max_gaussians": 400}
        | {"max_width": 640}
        | changed
    )


def run_of(dataset, wanted, countdown=None, said=None) -> Run:
    say = (said if said is not None else []).append
    cpu = torch.device("cpu")
    return Run(dataset, wanted, cpu, Ranks(), countdown, unreported, say, time.monotonic)
