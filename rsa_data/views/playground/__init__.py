"""A local page to try a head with pictures and sentences: `rsa-data play`.

Start at `desk.py` (what the page does) and `page.py` (what stands where).
"""
