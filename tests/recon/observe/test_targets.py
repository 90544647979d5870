"""Cache of views' targets: made once, on the device as long as it has room. Torch's `meta` is the device."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from recon.observe import targets
from recon.observe.targets import Targets, sent

META = torch.device("meta")


@dataclass(frozen=True)
class Planes:
    first: torch.Tensor
    second: torch.Tensor | None
    number: float


def test_views_are_made_once_and_kept_on_the_device_until_it_is_full(monkeypatch: pytest.MonkeyPatch) -> None:
    cache: Targets[Planes] = Targets()
    made: list[str] = []
    full = {"left": 100}
    monkeypatch.setattr(targets, "room", lambda device: full["left"])

    def look(name: str, width: int = 64) -> Planes:
        def make() -> Planes:
            made.append(name)
            return Planes(torch.ones(5, 5), None, 2.0)

        view = SimpleNamespace(name=name, held=True, lens=SimpleNamespace(width=width))
        return cache.of(view, make, META)

    for name, free in (("a", 100), ("b", 99), ("a", 0), ("b", 0)):  # 25 numbers take 100 bytes
        full["left"] = free
        planes = look(name)
        assert planes.first.device == META
        assert (planes.second, planes.number) == (None, 2.0)
    assert made == ["a", "b"]
    assert cache._cached["a"][1].first.device == META
    assert torch.equal(cache._cached["b"][1].first, torch.ones(5, 5))
    for width in (32, 32, 64):  # a view of another size has other targets, which take the place of these
        look("a", width)
    assert made == ["a", "b", "a", "a"]
    assert list(cache._cached) == ["a", "b"]


def test_an_array_of_several_views_is_kept_once() -> None:
    cache: Targets[Planes] = Targets()
    values, image = np.ones((3, 4), np.float32), torch.empty(3, 4, 3, device=META, dtype=torch.float64)
    first, second = (cache.array(values, image) for _ in range(2))
    assert (first.device, first.dtype, first.shape) == (META, torch.float64, (3, 4))
    assert second.device == META
    assert len(cache._arrays) == 1
    on_host = cache.array(values, torch.empty(0))
    assert on_host.data_ptr() == torch.from_numpy(values).data_ptr()


def test_what_is_there_is_not_sent() -> None:
    tensor = torch.ones(3)
    assert sent(tensor, torch.device("cpu")) is tensor
