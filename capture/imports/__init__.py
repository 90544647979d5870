"""`rig import`: photographs and data sets that exist, made a session byte for byte."""
