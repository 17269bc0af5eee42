"""What people look at: the report, the playground, pictures, and exports of tables.

Imports evaluation and below; nothing but cli imports it.
"""
