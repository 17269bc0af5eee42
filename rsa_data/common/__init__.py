"""What every room may use: errors, forms of JSON and TOML, units, class names, tokenizers, models.

Imports nothing else of this package.
"""
