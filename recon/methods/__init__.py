"""The methods: each a small composition of an appearance, an observation model and a loss."""

from collections.abc import Callable

from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.methods import hdr_gs, nh_3dgs, vanilla
from recon.methods.method import Method
from recon.scene.appearance import Appearance

METHODS: dict[str, Callable[[Dataset, Light], Method]] = {
    nh_3dgs.NAME: nh_3dgs.compose,
    hdr_gs.NAME: hdr_gs.compose,
    vanilla.NAME: vanilla.compose,
}

APPEARANCES: dict[str, Appearance] = {module.NAME: module.APPEARANCE for module in (nh_3dgs, hdr_gs, vanilla)}
"""Appearances for drawing a finished scene; floors and learning rates, which only training needs, are
arbitrary.
"""
