"""The networks a head can be, one a file; a line in the registry names each.

Start at `layers.py`.
"""
