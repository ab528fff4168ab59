"""One file for each scenario, their registry, and the code that their runs share."""
