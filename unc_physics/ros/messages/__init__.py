"""Messages to the core and back: one module for each message, with both directions."""
