"""Cameras as commands find them: on USB and on the network, and a rehearsal of a shoot."""
