"""What options of the command line are read from: those several commands take, and whole lines of text."""
