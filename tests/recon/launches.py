"""A count of the kernels that torch's operations would launch on a GPU."""

from typing import Any

from torch.utils._python_dispatch import TorchDispatchMode


class Launches(TorchDispatchMode):
    """Counts torch operations that compute or copy: on a GPU each is a kernel or more."""

    count = 0

    def __torch_dispatch__(self, function: Any, types: Any, arguments: Any = (), options: Any = None) -> Any:
        result = function(*arguments, **(options or {}))
        if not function.is_view and not function._schema.name.startswith(("aten::new_empty", "aten::detach")):
            self.count += 1
        return result
