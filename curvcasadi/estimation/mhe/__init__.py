"""The moving-horizon estimator."""
