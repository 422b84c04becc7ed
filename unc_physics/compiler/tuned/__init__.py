"""Fast compilation for tested versions of numba; all that depends on internals of numba is here."""
