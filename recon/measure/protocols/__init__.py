"""Published protocols of data sets, where they differ from `recon.measure.evaluate`."""
