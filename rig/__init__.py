"""The face of the toolkit: the `rig` command, its reports and its public API."""
