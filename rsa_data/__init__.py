"""From images to metric depth by way of words: captions, embeddings and a light head, staged.

The public Python API is what this module names; everything else may change between versions.
"""
