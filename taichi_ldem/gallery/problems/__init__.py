"""A file for each problem, which defines ``PROBLEM``; ``gallery.registry`` lists them."""
