"""Command line: one module per subject; commands import what they need when they run."""
