"""Modules of our own that are imported when a command uses them, though it names them at its top."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from threading import RLock
from types import ModuleType
from typing import Any

OURS = {"imaging", "drivers", "capture", "calib", "recon", "rig"}
_LOADING = RLock()


class _Deferred(Loader):
    """Leaves the code of a module until a name in it is asked for.

    `importlib.util.LazyLoader` runs it for `__file__` too, which inspect asks of all while torch loads.
    """

    def __init__(self, loader: Loader) -> None:
        self.loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Module(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        pass


class _Module(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        with _LOADING:
            spec = self.__spec__
            assert spec is not None
            if isinstance(spec.loader, _Deferred):
                spec.loader = self.__loader__ = spec.loader.loader
                try:
                    spec.loader.exec_module(self)
                except BaseException:
                    sys.modules.pop(self.__name__, None)
                    raise
                self.__class__ = ModuleType  # type: ignore[assignment]
        try:
            return self.__dict__[name]
        except KeyError:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}") from None


class _Finder(MetaPathFinder):
    """Finds our modules, not the packages that they are in."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if path is None or fullname.partition(".")[0] not in OURS:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.submodule_search_locations is not None or spec.loader is None:
            return None
        spec.loader = _Deferred(spec.loader)
        return spec


@contextmanager
def at_first_use() -> Iterator[None]:
    """Leave our modules that the block imports until a name in them is asked for.

    `from package import module` then runs none of it, and `from module import name` does.
    """
    finder = _Finder()
    sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        sys.meta_path.remove(finder)
