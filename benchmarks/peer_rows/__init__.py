"""Rows of benchmarks/peers.py: one module a row, and the scripts of the peers (their_*.py).

A peer's script runs in a process of its own, with a Python of its own where it wants other versions
of packages than this project. It takes one JSON object, writes what it found to `out` and prints
`{"steady": CPU seconds of the work itself}` as its last line.
"""
