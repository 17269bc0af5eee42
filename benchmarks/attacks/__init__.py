"""Attacks on the command line, one module a surface; `benchmarks/hostile.py` runs them.

Each module has `attacks(base, servers)`, which yields `harness.Attack`s. Start reading there.
"""
