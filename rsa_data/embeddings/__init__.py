"""The stages embed, embed-images, embed-objects and embed-proposals: frozen encoders.

Imports runner and below, no other stage. Start at `embed.py`, then `encoder.py` (what an encoder
is).
"""
