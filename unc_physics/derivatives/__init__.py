"""Derivatives of flight, contacts, impacts and actions with respect to the error state."""
