"""The stage depth: relative depth from models and files, sampled where there is ground truth.

Imports runner and below, no other stage. Start at `measure.py`, then `model.py` (what a depth model
is).
"""
