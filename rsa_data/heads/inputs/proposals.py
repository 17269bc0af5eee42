"""The input `proposals`: a detector's own features of an image's objects, side by side."""

from .kinds import Kind
from .vectors import of_proposals

PROPOSALS = Kind(of_proposals, "proposals", "rsa-data embed-proposals", vector=True)
