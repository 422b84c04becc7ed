"""Uncertainty propagation: one file for each propagator, and the one driver."""

from .predict import Prediction, predict
from .registry import PROPAGATORS, make_propagator

__all__ = ["PROPAGATORS", "Prediction", "make_propagator", "predict"]
