"""How data sets of papers measure a scene, where that is not how `recon.evaluate` does."""
