"""Compiled physics: numba functions over plain arrays; imports numpy, numba and the layout, nothing else."""
