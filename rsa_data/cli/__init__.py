"""The command line: each command parses, calls one library function and prints.

Imports every room below; nothing imports it. Start at `main.py`, whose table says which file holds
which command.
"""
