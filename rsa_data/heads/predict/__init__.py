"""predict: from captions or images to scale and shift, and on to metric depth.

Start at `predict.py`.
"""
