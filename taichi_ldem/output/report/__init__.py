"""The HTML page about a run or an ensemble."""
