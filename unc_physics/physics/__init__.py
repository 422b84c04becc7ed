"""Time steps of scenes."""
