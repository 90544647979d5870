"""The training loop, and what happens on the way. It starts from what is in `recon.start`; which training
runs is decided in `recon.decide`."""
