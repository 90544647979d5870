"""Simulated still cameras: a PTP responder with the ways of the makers, on USB and over TCP/IP."""
