"""Several hosts, one rig: a node serves its cameras, and one host leads."""
