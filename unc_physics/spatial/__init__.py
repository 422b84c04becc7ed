"""Rotations, vectors, layout of states, random numbers, and moments on the manifold."""
