"""Compiled physics: numba functions over plain arrays; imports numpy and numba, nothing else."""
