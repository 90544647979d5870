"""Shared parts of the benches: options, tables, trainings, errors by scene and seed."""
