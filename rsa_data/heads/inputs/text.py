"""The input `text`: the feature of a caption, one of an image's variants at a time."""

from . import scene
from .kinds import Kind
from .vectors import of_captions

TEXT = Kind(of_captions, made_by="rsa-data embed", vector=True, live=scene.TEXT)
