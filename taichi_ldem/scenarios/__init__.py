"""One file for each scenario, under its name: what a command runs from start to end.

``resumable`` says which of them ``ldem resume`` goes on with.
"""
