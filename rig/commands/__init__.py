"""One thin module a command: read the options, call the stage, tell the outcome."""
