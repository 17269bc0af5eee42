"""Metric depth as files: maps, coloured pictures, point clouds and meshes.

Start at `write.py`.
"""
