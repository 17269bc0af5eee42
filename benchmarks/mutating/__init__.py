"""Parts of mutation.py: where code can be changed, which tests run it, one trial."""
