"""Pictures of predictions and rankings; Matplotlib is imported when one is drawn."""
