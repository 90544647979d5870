"""The kernels of GPUs compiled for GPUs that are not there: what a thread of each needs.

    python -m bench.speed.gpu_kernels [--quick] [--json] [--write] [--targets sm_80 gfx942]

Triton compiles for any NVIDIA and AMD GPU without one, and keeps what it compiled by a hash of the kernel and
of itself. LIMITS hold what it needs: a sentence names what is beyond them, and the exit code is 1. --quick:
one GPU of each make. --write puts the table into bench/results/gpu_kernels.md.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

if __name__ == "__main__":  # read as Triton is first imported: interpreted kernels do not compile
    os.environ.pop("TRITON_INTERPRET", None)

import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource, make_backend

from bench.support.record import arguments, deliver
from recon.splat.gpu import composite, composite_backward, project, project_backward, slots, tiles

TARGETS = (
    "sm_75", "sm_80", "sm_86", "sm_89", "sm_90", "sm_100", "sm_120", "gfx90a", "gfx942", "gfx1100", "gfx1201",
)  # fmt: skip
"""RTX 20, A100, RTX 30, RTX 40, H100, B200, RTX 50; MI200, MI300, RX 7900, RX 9070."""
QUICK = ("sm_80", "gfx942")
F, D, B, S, I, L = "*fp32", "*fp64", "*i8", "*i16", "*i32", "*i64"  # noqa: E741
INPUTS = {"means": F, "quats": F, "scales": F, "opacities": F, "parameter": D, "n": "i32"}
GRID = {"across": "i32", "height": "i32", "width": "i32", "t_min": "fp32", "background": F}
LISTS = {"rows": F, "stride": "i32", "start": L, "chunk_start": L, "stored": F, "chunks": I}
KERNELS: list[tuple[Any, dict[str, Any], dict[str, Any], dict[str, str]]] = [
    *((project.project, {"BLOCK": project.BLOCK, "FISHEYE": fisheye}, {},
       INPUTS | {"record": F, "colours": F, "box": I, "depth": F, "radius": F, "state": B})
      for fisheye in (None, True)),
    *((tiles.match, {"BLOCK": tiles.MATCHED, "WRITE": write}, tiles.EXACT,
       {"record": F, "box": I, "state": B, "n": "i32", "across": "i32", "number": L, "start": L, "owner": I,
        "tile": S})
      for write in (False, True)),
    (tiles.gather, {"BLOCK": tiles.BLOCK}, {},
     {"record": F, "slot": L, "owner": I, "sorted_tile": S, "rows": F, "pairs": "i32", "stride": "i32",
      "across": "i32"}),
    (composite.composite, {"CHUNK": tiles.CHUNK, "KEEP": True}, {"num_warps": 1},
     LISTS | GRID | {"image": F, "remaining": F, "pairs": L}),
    (composite_backward.composite_backward, {"CHUNK": tiles.CHUNK},
     {"num_warps": 1},
     LISTS | GRID | {"slot": L, "grad_image": F, "grad_remaining": F, "slots": F}),
    (slots.add_slots, {"BLOCK": slots.BLOCK}, {"num_warps": slots.WARPS},
     {"slots": F, "start": L, "number": L, "n": "i32", "moments": F, "grad_colours": F, "pull": F,
      "weight": F}),
    *((project_backward.project_backward, {"BLOCK": project.BLOCK, "MOVING": True, "FISHEYE": fisheye}, {},
       INPUTS | {"moments": F, "weight": F, "grad_means": F, "grad_quats": F, "grad_scales": F,
                 "grad_opacities": F, "view": D})
      for fisheye in (None, True)),
]  # fmt: skip
NEEDS = ("registers", "stack", "shared")
LIMITS = {
    "project": (128, 0, 0),
    "match": (52, 0, 0),
    "gather": (44, 0, 1024),
    "composite": (128, 0, 512),
    "composite_backward": (160, 0, 512),
    "add_slots": (128, 0, 32),
    "project_backward": (240, 0, 32),
}
"""Most of NEEDS, by kernel: what Triton 3.6 to 3.9 take, and a little. 160 registers leave room for 12 warps
on a multiprocessor of NVIDIA's; AMD's GPUs have 512."""


def target_of(name: str) -> GPUTarget:
    """The target of a name; AMD's data-centre GPUs have warps of 64."""
    if name.startswith("sm_"):
        return GPUTarget("cuda", int(name[3:]), 32)
    return GPUTarget("hip", name, 64 if name.startswith("gfx9") else 32)


def compiled(names: list[str]) -> Iterator[dict[str, Any]]:
    """Compile each kernel for each target; one row of what it needs.

    KeyError for an option that the launch of a kernel there would refuse.
    """
    for kernel, constants, options, types in KERNELS:
        signature = {name: types.get(name, "constexpr") for name in kernel.arg_names}
        assert {name for name, of in signature.items() if of == "constexpr"} == set(constants)
        assert set(types) <= set(kernel.arg_names), set(types) - set(kernel.arg_names)
        places = {(kernel.arg_names.index(name),): value for name, value in constants.items()}
        kind = next((f" ({name.lower()})" for name in ("FISHEYE", "WRITE") if constants.get(name)), "")
        for name in names:
            target = target_of(name)
            chosen = {"num_warps": 4, **project.OPTIONS, **options}
            # As a launch does; compiling alone would let unknown ones pass.
            for option in set(chosen) - set(vars(make_backend(target).parse_options(chosen))):
                raise KeyError(f"{kernel.__name__} is launched with {option}, which {name} does not know")
            source = ASTSource(
                fn=kernel, signature=signature, constexprs=places, attrs=_aligned(kernel, types)
            )
            code = triton.compile(source, target=target, options=chosen)
            yield {
                "kernel": kernel.__name__ + kind,
                "target": name,
                "shared": code.metadata.shared,
                **(_of_cubin(code.asm["cubin"]) if "cubin" in code.asm else _of_gcn(code.asm["amdgcn"])),
            }


def _aligned(kernel: Any, types: dict[str, str]) -> dict[tuple[int], list[list[Any]]]:
    """Alignment of the tensors as a launch finds it: torch's begin at multiples of 512 bytes."""
    apart = {param.name for param in kernel.params if param.do_not_specialize_on_alignment}
    return {
        (kernel.arg_names.index(name),): [["tt.divisibility", 16]]
        for name, of in types.items()
        if of.startswith("*") and name not in apart
    }


def _of_cubin(cubin: bytes) -> dict[str, int]:
    """Registers of a thread, and bytes of its stack, which is what is spilled."""
    tool = Path(triton.__file__).parent / "backends" / "nvidia" / "bin" / "cuobjdump"
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(cubin)
        file.flush()
        command = [str(tool), "--dump-resource-usage", file.name]
        text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    registers, stack = (int(re.findall(rf"{name}:(\d+)", text)[-1]) for name in ("REG", "STACK"))
    return {"registers": registers, "stack": stack}


def _of_gcn(text: str) -> dict[str, int]:
    """Vector registers of a lane, and bytes of its stack."""
    registers, stack = (
        int(re.findall(rf"\.{name}: +(\d+)", text)[-1])
        for name in ("vgpr_count", "private_segment_fixed_size")
    )
    return {"registers": registers, "stack": stack}


def beyond(rows: list[dict[str, Any]]) -> list[str]:
    """List what needs more than LIMITS, a sentence each."""
    return [
        f"{row['kernel']} on {row['target']} takes {row[name]} {name}, {most} at most"
        for row in rows
        for name, most in zip(NEEDS, LIMITS[row["kernel"].split(" ")[0]], strict=True)
        if row[name] > most
    ]


def report(result: dict[str, Any]) -> str:
    rows = result["rows"]
    targets = list(dict.fromkeys(row["target"] for row in rows))
    lines = [
        "# The kernels of GPUs, compiled",
        "",
        f"`python -m bench.speed.gpu_kernels --write`: Triton {triton.__version__}, no GPU needed. Registers "
        f"of a thread / bytes of its stack. {'; '.join(result['beyond']) or 'All are within their limits'}.",
        "",
        f"| kernel | {' | '.join(targets)} |",
        f"|---|{'---|' * len(targets)}",
    ]
    for kernel in dict.fromkeys(row["kernel"] for row in rows):
        cells = [f"{row['registers']} / {row['stack']}" for row in rows if row["kernel"] == kernel]
        lines.append(f"| {kernel} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--targets", nargs="+", choices=TARGETS)
    options = parser.parse_args()
    rows = list(compiled(options.targets or list(QUICK if options.quick else TARGETS)))
    result = {"rows": rows, "beyond": beyond(rows)}
    deliver(options, "gpu_kernels", result, report(result))
    sys.exit(1 if result["beyond"] else 0)


if __name__ == "__main__":
    main()
