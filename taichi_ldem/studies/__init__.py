"""Studies that are commands: each makes many runs and writes a table of them."""
