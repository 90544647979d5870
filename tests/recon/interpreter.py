"""Triton's interpreter, which runs the GPU's kernels on the CPU, without half of its work."""

import inspect
from typing import Any

import pytest


def quick_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let it remember what is built into Triton's language.

    At each call of a kernel's function it would look for that among all names, which is half of its time.
    """
    from triton.runtime import interpreter

    known: dict[Any, list[str]] = {}
    is_builtin, replace_one = interpreter.tl.core.is_builtin, interpreter._patch_attr

    def replace_all(package: Any, builder: Any, scope: Any) -> None:
        if package not in known:
            known[package] = [name for name, member in inspect.getmembers(package) if is_builtin(member)]
        for name in known[package]:
            member = getattr(package, name)
            if is_builtin(member):  # and not replaced yet
                replace_one(package, name, member, builder, scope)

    monkeypatch.setattr(interpreter, "_patch_builtin", replace_all)
