"""Adam, without the second and a half in which the first of torch's optimizers imports a compiler."""

from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor


class Adam:
    """Adam (Kingma and Ba, ICLR 2015), each step one pass over memory by the kernel of torch's fused Adam.

    A group is a dict with its `params` and `lr`, `betas` where they are not the usual ones, and what else the
    caller keeps there; rates and momenta are read at each step. state: of each parameter that ever had a
    gradient, `step` and the two moving averages `exp_avg` and `exp_avg_sq`.

    `torch.optim.Adam` takes the same steps, but its constructor imports `torch._dynamo`, which for a short
    training is a tenth of its time.

    Curvature did not earn its place: with the diagonal of Gauss and Newton's matrix, as 3DGS2-TR has it
    (Hsiao et al., arXiv 2602.00395), here from random signs sent backwards through the render, and steps
    bounded by Adam's rates, each at its best, the light was -0.1 to +0.2 dB better after as many iterations
    (200 and 400, demo and gallery, 20,000 Gaussians, one seed), which took a quarter longer. On two real sets
    the held-out views are 0.5 and 0.9 dB worse (`bench/speed/curvature.py`).
    """

    def __init__(self, groups: Iterable[dict[str, Any]], eps: float = 1e-8) -> None:
        self.param_groups = [{"betas": (0.9, 0.999), **group} for group in groups]
        self.state: dict[Tensor, dict[str, Tensor]] = {}
        self.eps = eps

    def zero_grad(self) -> None:
        """Forget all gradients."""
        for group in self.param_groups:
            for value in group["params"]:
                value.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Move every parameter that has a gradient."""
        for group in self.param_groups:
            moved = [value for value in group["params"] if value.grad is not None]
            if not moved:
                continue
            self.state |= {value: _begun(value) for value in moved if value not in self.state}
            states = [self.state[value] for value in moved]
            steps = [state["step"].add_(1) for state in states]
            beta1, beta2 = group["betas"]
            torch._fused_adam_(
                moved,
                [value.grad for value in moved],
                [state["exp_avg"] for state in states],
                [state["exp_avg_sq"] for state in states],
                [],
                steps,
                lr=group["lr"],
                beta1=beta1,
                beta2=beta2,
                weight_decay=0.0,
                eps=self.eps,
                amsgrad=False,
                maximize=False,
            )

    def tensors(self) -> dict[str, Tensor]:
        """The memory as flat tensors, by `NAME.KEY` of groups that have a name and one parameter."""
        return {
            f"{group['name']}.{key}": value
            for group in self.param_groups
            for key, value in self.state.get(group["params"][0], {}).items()
        }

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Take the memory back that `tensors` gave."""
        for group in self.param_groups:
            prefix, value = group["name"] + ".", group["params"][0]
            state = {
                key.removeprefix(prefix): tensor.to(value.device)
                for key, tensor in tensors.items()
                if key.startswith(prefix)
            }
            if state:
                self.state[value] = state


def _begun(value: Tensor) -> dict[str, Tensor]:
    """The memory of a parameter that was not moved yet."""
    return {
        "step": torch.zeros((), device=value.device),
        "exp_avg": torch.zeros_like(value),
        "exp_avg_sq": torch.zeros_like(value),
    }
