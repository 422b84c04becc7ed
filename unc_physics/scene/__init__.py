"""Scenes: bodies, environment, materials, uncertain parameters, beliefs, and scene files."""
