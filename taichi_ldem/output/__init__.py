"""Figures, pictures, movies and reports of a run."""
