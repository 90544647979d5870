"""`rig check`: what is wrong with a session, and its repair. It judges and repairs, and never shoots."""
