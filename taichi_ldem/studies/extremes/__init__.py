"""Stiff and extreme cases: ``ldem study extremes`` compares each with what theory predicts."""
