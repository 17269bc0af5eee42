"""Heads: small networks that turn features of a scene into scale and shift.

`architectures/` holds one network a file, `train/` the training of one, `predict/` its use. Imports
the stage rooms and below. Start at `checkpoint.py` (a trained head).
"""
