"""What every stage shares: jobs, parts, fingerprints, engines, chains, status and verify.

Reaches stages through registry strings only; imports datasets, store, registry and common. Start at
`stage.py` (what a stage is), then `jobs.py` (a stage over one dataset) and `runs.py` (one run of a
job).
"""
