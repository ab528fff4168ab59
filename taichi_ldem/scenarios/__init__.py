"""One file for each scenario, their registry, and what their runs have in common."""
