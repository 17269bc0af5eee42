"""One HTML file that shows what a work dir holds; opens without a server or a network.

Start at `build.py`.
"""
