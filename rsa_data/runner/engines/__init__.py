"""Who runs which part where: this process, local processes, or Ray actors.

Start at `pool.py`, the loop that all engines share.
"""
