"""One file for each scenario: what a command runs from start to end."""
