"""The stage detect: ONNX models with their decoders, and importers of existing segments.

Imports runner and below, no other stage. Start at `detect.py`, then `segments.py` (what one image
shows).
"""
