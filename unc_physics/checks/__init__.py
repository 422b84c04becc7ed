"""What bad input meets: the errors, and the checks of single values that raise them."""
