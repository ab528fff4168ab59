"""Studies that made the numbers of docs/; not part of the package."""
