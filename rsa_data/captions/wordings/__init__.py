"""Wordings: how each style says what an image shows, one file each. Start at `wording.py`."""
