"""Exact solutions: what the numerical ones are tested against, and the basis of the predictor."""
