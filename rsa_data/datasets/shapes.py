"""Whether a map (of depth) has the shape of the image that it is said to belong to."""

from ..common.errors import RowError

# Sides rounded to multiples of 32 px of small maps change the aspect by no more.
TOLERANCE = 0.05


def check_aspect(shape: tuple[int, int], image: tuple[int, int], what: str) -> None:
    """Raises RowError unless a map has the aspect of an image, within 5%.

    shape : height and width of the map.  image : width and height of the image as displayed.
    """
    (height, width), (image_width, image_height) = shape, image
    if _alike(width / height, image_width / image_height):
        return
    found = f"{width} x {height}"
    if _alike(height / width, image_width / image_height):
        raise RowError(
            f"{what}: expected the aspect of its image of {image_width} x {image_height} px, found "
            f"{found}, which is transposed. Turn it, or write the image upright"
        )
    raise RowError(
        f"{what}: expected the aspect of its image of {image_width} x {image_height} px, within "
        f"{TOLERANCE:.0%}; found {found}. Align the two, or crop one to the other"
    )


def check_turn(shape: tuple[int, int], image: tuple[int, int], orientation: int, what: str) -> None:
    """Raises RowError for a map that may lie as the stored pixels of an image that EXIF turns.

    shape : height and width of the map, which has the aspect of the image.  image : width and
    height as displayed.  orientation : EXIF's, 1 to 8.
    """
    width, height = image
    if orientation == 1 or (orientation >= 5 and not _alike(width / height, height / width)):
        return
    raise RowError(
        f"{what}: the image is turned for display (EXIF orientation {orientation}), and whether "
        f"the map of {shape[1]} x {shape[0]} px is cannot be told. Write the image upright"
    )


def _alike(a: float, b: float) -> bool:
    return abs(a / b - 1) <= TOLERANCE
