"""Text that other programs wrote: its byte-order mark, and where its lines end."""


def decode(data: bytes) -> str:
    """The text of UTF-8 bytes, without a byte-order mark.

    Raises ValueError that says what was found when the bytes are not UTF-8.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ValueError("UTF-16 text; save the file as UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = error.object[error.start]
        raise ValueError(f"byte {byte:#x} at offset {error.start}, which is not UTF-8") from error


def lines(text: str) -> list[str]:
    """The lines of a text, which end at line feeds only; a carriage return before one is dropped.

    Other separators (form feed, U+0085, U+2028) are characters of the line, unlike in
    str.splitlines. Nothing follows the last line feed.
    """
    found = [line.removesuffix("\r") for line in text.split("\n")]
    return found[:-1] if found[-1] == "" else found


def encodable(text: str) -> bool:
    """Whether UTF-8 can hold a text: not the bytes of a command line that are no UTF-8."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True
