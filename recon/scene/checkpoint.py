"""A training on disk: everything that the next iteration depends on, as safetensors."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from imaging.errors import ReconstructionError
from imaging.files import store

FORMAT = "hdr-rig training 2"


@dataclass(frozen=True)
class Checkpoint:
    """tensors: by `gaussians.`, `shared.`, `environment.`, `adam.` and other names; facts: anything JSON."""

    tensors: dict[str, Tensor]
    facts: dict[str, Any]

    def part(self, prefix: str) -> dict[str, Tensor]:
        """The tensors whose names begin with `prefix.`, without it."""
        start = prefix + "."
        return {key[len(start) :]: value for key, value in self.tensors.items() if key.startswith(start)}


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write it whole, or not at all."""
    tensors = {name: value.detach().cpu().contiguous() for name, value in checkpoint.tensors.items()}
    facts = {"format": FORMAT, "facts": json.dumps(checkpoint.facts, allow_nan=False, sort_keys=True)}
    store.write_bytes(path, save(tensors, facts))


def read_checkpoint(path: Path) -> Checkpoint:
    """Read it back; ReconstructionError when it is missing or not one of ours."""
    try:
        data = path.read_bytes()
        length = int.from_bytes(data[:8], "little")
        header = json.loads(data[8 : 8 + length])["__metadata__"]
        if header["format"] != FORMAT:
            raise ReconstructionError(f"{path} has format {header['format']!r}: reconstruct again.")
        return Checkpoint(load(data), json.loads(header["facts"]))
    except FileNotFoundError as error:
        raise ReconstructionError(f"{path} is missing: run `rig reconstruct` first.") from error
    except (OSError, ValueError, KeyError, TypeError, SafetensorError) as error:
        raise ReconstructionError(f"{path} is damaged: delete it and reconstruct again.") from error
