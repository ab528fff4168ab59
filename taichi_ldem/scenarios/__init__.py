"""One file for each scenario, under its name: what a command runs from start to end.

A scenario that steps in time has ``run`` and ``summary`` (see ``runner.Summary``): ``ldem resume``
finds the latter by the scene's ``scenario``.
"""
