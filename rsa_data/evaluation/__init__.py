"""Metrics, protocols, oracles, comparisons, and how the results are written.

Imports heads and below. Start at `evaluate.py`; a metric is defined in `metrics.py`.
"""
