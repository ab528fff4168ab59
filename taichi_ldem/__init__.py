"""Lattice discrete element method (LDEM) for brittle plates under impact, on Taichi."""

__version__ = "0.1.0"
