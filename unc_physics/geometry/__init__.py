"""Geometry: sphere packings of meshes, their files, and the model library."""
