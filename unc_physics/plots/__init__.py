"""Pictures of predictions and rankings; Matplotlib is imported only for drawing."""
