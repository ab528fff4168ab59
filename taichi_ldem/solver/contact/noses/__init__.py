"""Noses of the striker: a file for each value of the scene's ``striker.shape``, of the same name.

To add a nose, write its file and name it among the values of ``striker.shape`` in the scene's
schema. The file defines ``NOSE``. Nothing here imports Taichi: ``Nose.surface`` is plain Python
text that the striker's kernels compile.
"""

from importlib import import_module

from taichi_ldem.solver.contact.nose import Nose

__all__ = ["Nose", "nose_of"]


def nose_of(shape: str) -> Nose:
    """The nose that a scene's ``striker.shape`` names."""
    nose: Nose = import_module(f"{__name__}.{shape}").NOSE
    return nose
