"""Data sets of papers, trained and measured as their papers do it: import, calibration, scene, table."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.benchmarks.protocol import Protocol


def protocols() -> "dict[str, Protocol]":
    """Protocols by their names on the command line."""
    from rig.benchmarks.eth3d import ETH3D
    from rig.benchmarks.hdr_nerf import HDR_NERF
    from rig.benchmarks.hdr_plenoxels import HDR_PLENOXELS
    from rig.benchmarks.hdr_pretrain import HDR_PRETRAIN
    from rig.benchmarks.rawnerf import RAWNERF
    from rig.benchmarks.realx3d import REALX3D

    return {
        "rawnerf": RAWNERF,
        "hdr-nerf": HDR_NERF,
        "hdr-plenoxels": HDR_PLENOXELS,
        "hdr-pretrain": HDR_PRETRAIN,
        "realx3d": REALX3D,
        "eth3d": ETH3D,
    }
