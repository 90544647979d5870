"""How a command is_main_process: progress, tables, failures, the person at the rig."""
