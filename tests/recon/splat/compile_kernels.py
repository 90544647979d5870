"""Compile the Triton kernels ahead of time, without a GPU; JSON on stdout: what each needs on each GPU.

    python compile_kernels.py 80 90

A process of its own, since Triton decides at import whether kernels are compiled or interpreted.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource

from recon.splat.gpu import composite, composite_backward, project, project_backward, slots, tiles

F, D, B, S, I, L = "*fp32", "*fp64", "*i8", "*i16", "*i32", "*i64"  # noqa: E741
INPUTS = {"means": F, "quats": F, "scales": F, "opacities": F, "parameter": D, "n": "i32"}
RECORDS = {"record": D, "paint": F}
GRID = {"across": "i32", "height": "i32", "width": "i32", "t_min": "fp32", "background": F}
LISTS = {"rows": F, "stride": "i32", "start": L, "chunk_start": L, "stored": F, "chunks": I}
KERNELS = [
    *((project.project, {"BLOCK": project.BLOCK, "FISHEYE": fisheye}, {},
       INPUTS | RECORDS | {"colours": F, "box": I, "depth": F, "radius": F, "state": B, "number": L})
      for fisheye in (None, True)),
    (tiles.match, {"BLOCK": tiles.BLOCK}, {},
     RECORDS | {"owner": I, "start": L, "box": I, "tile": S, "touched": B, "pairs": "i32", "across": "i32",
                "tiles": "i32"}),
    (tiles.gather, {"BLOCK": tiles.BLOCK}, {},
     RECORDS | {"slot": L, "owner": I, "sorted_tile": S, "rows": F, "pairs": "i32", "stride": "i32",
                "across": "i32", "tiles": "i32"}),
    (composite.composite, {"CHUNK": tiles.CHUNK, "KEEP": True}, {"num_warps": 1},
     LISTS | GRID | {"image": F, "remaining": F, "pairs": L}),
    (composite_backward.composite_backward, {"CHUNK": tiles.CHUNK},
     {"num_warps": 1, "maxnreg": composite_backward.REGISTERS},
     LISTS | GRID | {"slot": L, "grad_image": F, "grad_remaining": F, "slots": F}),
    (slots.add_slots, {"BLOCK": slots.BLOCK}, {"num_warps": slots.WARPS},
     {"slots": F, "start": L, "number": L, "tile": S, "record": D, "n": "i32", "across": "i32", "moments": D,
      "grad_colours": F, "pull": F, "weight": F}),
    *((project_backward.project_backward, {"BLOCK": project.BLOCK, "MOVING": True, "FISHEYE": fisheye}, {},
       INPUTS | {"moments": D, "weight": F, "grad_means": F, "grad_quats": F, "grad_scales": F,
                 "grad_opacities": F, "view": D})
      for fisheye in (None, True)),
]  # fmt: skip


def resources(cubin: bytes) -> dict[str, int]:
    """Registers (REG) and bytes of stack, which is what is spilled (STACK), a thread."""
    tool = Path(triton.__file__).parent / "backends" / "nvidia" / "bin" / "cuobjdump"
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(cubin)
        file.flush()
        command = [str(tool), "--dump-resource-usage", file.name]
        text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    numbers = dict(part.split(":")[:2] for part in text.splitlines()[-1].split() if part.count(":") == 1)
    return {name: int(numbers[name]) for name in ("REG", "STACK")}


def main() -> None:
    rows = []
    for kernel, constants, options, types in KERNELS:
        signature = {name: types.get(name, "constexpr") for name in kernel.arg_names}
        assert {name for name, kind in signature.items() if kind == "constexpr"} == set(constants)
        assert set(types) <= set(kernel.arg_names), set(types) - set(kernel.arg_names)
        places = {(kernel.arg_names.index(name),): value for name, value in constants.items()}
        for architecture in map(int, sys.argv[1:]):
            compiled = triton.compile(
                ASTSource(fn=kernel, signature=signature, constexprs=places),
                target=GPUTarget("cuda", architecture, 32),
                options={"num_warps": 4, "enable_fp_fusion": True, **options},
            )
            cubin = compiled.asm["cubin"]
            rows.append(
                {
                    "kernel": kernel.__name__,
                    "architecture": architecture,
                    "cubin": len(cubin),
                    "elf": cubin[:4] == b"\x7fELF",
                    "shared": compiled.metadata.shared,
                    **resources(cubin),
                }
            )
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
