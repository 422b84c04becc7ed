"""Beliefs that are kept while measurements arrive: rollouts that a Kalman filter corrects."""
