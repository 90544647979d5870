"""Albedo and irradiance of a scene's Gaussians, for programs that light it anew."""
