"""Heads: the small networks that turn features of a scene into scale and shift, and their use."""
