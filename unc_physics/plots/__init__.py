"""Pictures of predictions; Matplotlib is imported only for drawing."""
