"""From a scene and a belief to a prediction, and what it answers: islands, probabilities, status."""
