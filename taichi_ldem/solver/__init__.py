"""The lattice stepped in time: all Taichi kernels."""
