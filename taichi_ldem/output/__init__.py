"""What is drawn of a run: figures, pictures, movies, reports."""
