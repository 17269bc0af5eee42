"""Metrics, protocols, oracles, and the evaluation that puts a head beside its baselines."""
