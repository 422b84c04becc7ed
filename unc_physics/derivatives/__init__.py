"""Derivatives of flight, contacts, impacts and actions by errors of the state."""
