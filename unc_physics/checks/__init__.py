"""Errors of bad input, and the checks of single values that raise them."""
