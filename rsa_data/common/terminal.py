"""Text for terminals: what a terminal would obey is shown instead.

Names of files, labels, captions, model ids and servers' words may hold anything. The standard
streams of a command pass all that they print through `plain`; see cli.process.
"""

import re

# C0 and C1 but tab and line feed, delete, and the marks that change the direction of text or
# begin a line.
_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")


def plain(text: str) -> str:
    """The text with every control character as its escape, such as \\x1b."""
    return _OBEYED.sub(lambda found: ascii(found[0])[1:-1], text)
