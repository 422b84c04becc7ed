"""Uncertainty propagation: one file for each propagator, their base class, and the registry."""
