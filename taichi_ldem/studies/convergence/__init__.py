"""Error against run time: ``ldem study convergence`` over resolution, time step, precision."""
