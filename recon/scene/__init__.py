"""The model of a scene: Gaussians, their colours, and both on disk. How it is trained is in `recon.train`."""
