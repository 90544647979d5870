"""Protocols of papers by their names on the command line."""

from rig.benchmarks.eth3d import ETH3D
from rig.benchmarks.hdr_nerf import HDR_NERF
from rig.benchmarks.hdr_plenoxels import HDR_PLENOXELS
from rig.benchmarks.hdr_pretrain import HDR_PRETRAIN
from rig.benchmarks.protocol import Protocol
from rig.benchmarks.rawnerf import RAWNERF
from rig.benchmarks.realx3d import REALX3D

PROTOCOLS: dict[str, Protocol] = {
    "rawnerf": RAWNERF,
    "hdr-nerf": HDR_NERF,
    "hdr-plenoxels": HDR_PLENOXELS,
    "hdr-pretrain": HDR_PRETRAIN,
    "realx3d": REALX3D,
    "eth3d": ETH3D,
}
