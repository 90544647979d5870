"""Resources of the machine: compiled kernels, threads and memory. Nothing here knows of cameras or scenes."""
