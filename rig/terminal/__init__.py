"""How a command speaks: progress, tables, failures, the person at the rig."""
