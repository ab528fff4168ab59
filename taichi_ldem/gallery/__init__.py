"""The problems of the literature that everybody runs first, each next to a number from elsewhere.

``problem`` says what a problem is, ``problems`` holds a file for each, ``scenes`` their scenes,
``registry`` their order; ``conduct`` runs them, ``page`` writes what came out.
"""
