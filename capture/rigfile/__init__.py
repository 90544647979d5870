"""`RIG.toml`: which cameras make a rig and how it is shot."""
