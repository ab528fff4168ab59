"""x"""
from taichi_ldem.scenarios import runner
def run(scene, out, *, force=False, quiet=False):
    return runner.run(scene, out, lambda s,h: {}, force=force, quiet=quiet)
