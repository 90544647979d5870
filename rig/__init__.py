"""The face of the toolkit: the `rig` command, its reports and its public API.

    import rig

    rig.capture_simulated("demo", "S", seed=0)
    session = rig.Session.open("S")
    rig.calibrate(session)
    scene = rig.reconstruct(session, quality="draft")
    print(rig.evaluate(scene).hdr_psnr_mu_aligned)
    light = scene.render("0000/cam0")      # linear radiance, float32 [H, W, 3]
    scene.at(2.0).save("brighter.png")     # two stops above middle grey, as a display shows it

A session or a scene can be given wherever a path to its folder can, as `str` or `Path`. What comes back is
a typed record. `on_progress` is called with what is being done, the steps that are done, and all of them (0
where their number is not known); `on_message` with lines that stay. What goes wrong is a `RigError` of one
sentence. `import rig` loads nothing heavy: each name in `__init__.pyi` is fetched from its stage when it is
first used.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8"))
"""Names are listed once, where type checkers and editors look for them."""
_HOMES = {
    name.name: node.module for node in _STUB.body if isinstance(node, ast.ImportFrom) for name in node.names
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("hdr-rig")
    if name not in _HOMES:
        raise AttributeError(f"module 'rig' has no attribute {name!r}")
    value = getattr(import_module(str(_HOMES[name])), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, "__version__"})
