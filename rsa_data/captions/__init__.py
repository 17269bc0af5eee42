"""Captions: what the segments of an image say, in words, within a text encoder's reach."""
