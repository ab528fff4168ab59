"""The lattice and its material as arrays: NumPy only."""
