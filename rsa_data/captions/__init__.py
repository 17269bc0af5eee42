"""The stage captions: segments become texts within a text encoder's reach.

Imports runner and below, no other stage. Start at `write.py`; wordings are in `wordings/`.
"""
