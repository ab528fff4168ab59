"""The curves of all figures, described once as data; Matplotlib and the HTML report draw them."""
