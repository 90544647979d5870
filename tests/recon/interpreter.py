"""Triton's interpreter, which runs the GPU's kernels on the CPU, without half of its work."""

import inspect
from typing import Any

import pytest


def quick_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let it remember what is built into Triton's language, and what it has replaced for a launch.

    At each call of a kernel's function it would look for that among all names, which is half of its time,
    and replace again what it replaced at the first.
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

    replaced: set[int] = set()
    launch, replace_for = interpreter.GridExecutor.__call__, interpreter._patch_lang

    def launched(executor: Any, *arguments: Any, **named: Any) -> Any:
        replaced.clear()  # the launch before put all back at its end
        return launch(executor, *arguments, **named)

    def replace_once(function: Any) -> Any:
        names = id(function.__globals__)
        if names in replaced:
            return interpreter._LangPatchScope()
        replaced.add(names)
        return replace_for(function)

    monkeypatch.setattr(interpreter, "_patch_builtin", replace_all)
    monkeypatch.setattr(interpreter.GridExecutor, "__call__", launched)
    monkeypatch.setattr(interpreter, "_patch_lang", replace_once)
