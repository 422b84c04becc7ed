"""How far predictions are from the truth, and in which scenes that is measured."""
