"""Which images there are and how to read them: definitions, index, images, depth, roots.

Imports store, registry and common. Start at `dataset.py` (what the pipeline knows of a dataset),
then `index.py` (how its samples table is written).
"""
