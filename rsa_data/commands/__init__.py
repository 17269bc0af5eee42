"""The commands, by subject; rsa_data/cli.py says which name is which."""
