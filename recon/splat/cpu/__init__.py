"""The rasteriser as Numba kernels."""
