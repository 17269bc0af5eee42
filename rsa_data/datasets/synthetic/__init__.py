"""Rendered rooms and streets with true metric sizes: for demos and regression, never a result."""
