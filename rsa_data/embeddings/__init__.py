"""The stages embed, embed-images and embed-proposals: frozen encoders, once per input.

Imports runner and below, no other stage. Start at `embed.py`, then `encoder.py` (what an encoder
is).
"""
