"""Adam against torch's own."""

import pytest
import torch

from recon.train.adam import Adam

SHAPES = {"means": (40, 3), "quats": (40, 4), "gain": (1,), "unseen": (5, 2)}


def parameters() -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(4)
    return {name: torch.randn(shape, generator=generator) for name, shape in SHAPES.items()}


def groups_of(values: dict[str, torch.Tensor]) -> list[dict]:
    return [
        {"name": name, "params": [value.requires_grad_(True)], "lr": 0.1} for name, value in values.items()
    ]


def walk(optimizer: Adam | torch.optim.Optimizer, steps: range) -> None:
    """With rates and momenta that change on the way, and a parameter that never has a gradient."""
    for step in steps:
        for group in optimizer.param_groups:
            group["lr"] = 0.1 * 0.8**step
            group["betas"] = (0.9, 0.999) if step < 10 else (0.81, 0.998)
        optimizer.zero_grad()
        values = {group["name"]: group["params"][0] for group in optimizer.param_groups}
        loss = sum((value.square() * (1 + step)).sum() for name, value in values.items() if name != "unseen")
        loss.backward()
        optimizer.step()


@pytest.mark.parametrize("eps", [1e-8, 1e-15])
def test_it_moves_everything_as_the_one_of_torch_does(eps):
    ours, theirs = parameters(), parameters()
    walk(Adam(groups_of(ours), eps=eps), range(20))
    walk(torch.optim.Adam(groups_of(theirs), eps=eps, fused=True), range(20))
    for name, value in ours.items():
        assert torch.equal(value, theirs[name]), name
    assert torch.equal(ours["unseen"], parameters()["unseen"])
    assert not torch.equal(ours["means"], parameters()["means"])


def test_a_restored_one_goes_on_as_if_it_had_never_stopped():
    whole, parts = parameters(), parameters()
    walk(Adam(groups_of(whole)), range(12))
    first = Adam(groups_of(parts))
    walk(first, range(7))
    copies = {name: value.detach().clone() for name, value in parts.items()}
    second = Adam(groups_of(copies))
    second.restore({name: value.clone() for name, value in first.tensors().items()})
    assert second.tensors().keys() == {
        f"{name}.{key}" for name in SHAPES if name != "unseen" for key in ("step", "exp_avg", "exp_avg_sq")
    }
    walk(second, range(7, 12))
    for name, value in copies.items():
        assert torch.equal(value, whole[name]), name
