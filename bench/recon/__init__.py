"""Reconstruction, measured: methods, presets, budgets, predictions, choices, stability."""
