"""The work dir: tables of Parquet parts, receipts, schemas, logs, and the object stores below.

Imports registry and common. Start at `tables.py`.
"""
