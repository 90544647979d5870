"""Compiled kernels of image formation and their gradients."""
