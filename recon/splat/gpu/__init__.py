"""The rasteriser on a CUDA GPU, in Triton: the algorithm and the cut-offs of the CPU kernels.

`project` finds each Gaussian's ellipse, `tiles` lists the Gaussians of each tile of 16x8 pixels, `composite`
blends them; `composite_backward`, `slots` and `project_backward` (with `project_view`) go the way back. Only
this package imports Triton, which comes with torch's CUDA builds. With TRITON_INTERPRET=1 set before Triton
is imported, the same code runs on CPU tensors, slowly: that is how it is tested without a GPU.
"""

from recon.splat.gpu.rasterizer import rasterize_gpu

__all__ = ["rasterize_gpu"]
