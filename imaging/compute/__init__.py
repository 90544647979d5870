"""What the machine gives: compiled kernels, threads and memory. Nothing here knows of cameras or scenes."""
