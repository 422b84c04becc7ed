"""Measurements: run from the repository's root, for example ``python -m
unc_physics_evaluation.benchmarks.propagators``.
"""
