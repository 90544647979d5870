"""Every bench can be imported, and what it replaces in the product is there."""

import importlib
import pkgutil
import re
from pathlib import Path

import pytest

import bench

ROOT = Path(bench.__path__[0])
MODULES = [path for path in sorted(ROOT.rglob("*.py")) if path.name != "__init__.py"]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_bench_can_be_imported_and_patches_what_is_there(path):
    importlib.import_module(".".join(path.relative_to(ROOT.parent).with_suffix("").parts))
    for target in re.findall(r'mock\.patch\(\s*"([\w.]+)"', path.read_text(encoding="utf-8")):
        pkgutil.resolve_name(target)


def test_no_two_benches_write_the_same_table():
    names = [
        name
        for path in MODULES
        for call in re.findall(
            r"\bdeliver\(\s*options,\s*([^)]*?),\s*result", path.read_text(encoding="utf-8")
        )
        for name in re.findall(r'"(\w+)"', call)
    ]
    assert len(names) > 50
    assert sorted({name for name in names if names.count(name) > 1}) == []
