"""Browser view of predictions: moving scenes with their uncertainty."""
