"""The input `image`: the feature of the image itself."""

from . import scene
from .kinds import Kind
from .vectors import of_images

IMAGE = Kind(of_images, "images", made_by="rsa-data embed-images", vector=True, live=scene.IMAGE)
