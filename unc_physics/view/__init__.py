"""Predictions to look at in a browser: scenes that move, with what is uncertain about them."""
