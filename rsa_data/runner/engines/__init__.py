"""Who runs which part where: this process, local processes, or Ray actors.

Start at `pool.py` (what an engine is made of), then `dispatch.py` (the loop of all engines).
"""
