"""Conversion between messages and the core: one module per message, for both directions."""
