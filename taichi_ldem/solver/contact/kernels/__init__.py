"""The kernels of the rigid bodies: one file for each body, and what they share."""
