"""Fast compilation for tested versions of numba, with all code that depends on internals of numba."""
