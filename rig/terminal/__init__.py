"""Interaction of commands with people: progress, tables, failures, the operator at the rig."""
