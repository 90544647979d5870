"""What the benches share: options, tables, trainings, errors by scene and seed."""
