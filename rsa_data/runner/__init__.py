"""What every stage shares: jobs, parts, fingerprints, engines, chains, status and verify.

Reaches stages through registry strings only; imports datasets, store, registry and common. Start at
`stages.py` (what a stage is), then `runs.py` (one run of one stage over one dataset).
"""
