"""The HTML page of a run, and the parts of which pages are made."""
