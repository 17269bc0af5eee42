"""The models of the shipped cards: what is on this machine, and whether they do what they should.

Start at `listing.py`, then `check.py`.
"""
