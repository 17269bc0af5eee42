"""What a head can read of an image, one kind a file; a line in the registry names each.

Start at `kinds.py`. A head names the kinds that it reads in its class; see `architectures.layers`.
"""
