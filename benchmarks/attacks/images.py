"""Images and depth maps: one hostile file beside good ones; its row fails, the others are done."""

import gzip
import io
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from .harness import ACCEPTED, CONTAINED, FAILED, Attack
from .world import World

EMBED = (
    "embed-images",
    "--work",
    "work",
    "--dataset",
    "folder:own",
    "--root",
    "in",
    "--encoder",
    "thumbnail",
)
DEPTH = (
    "depth",
    "--work",
    "work",
    "--dataset",
    "folder:own",
    "--root",
    "in",
    "--dataset-option",
    "depth=depth",
    "--dataset-option",
    "depth_unit=mm",
    "--depth-model",
    "files:relative",
)
OTHERS = r"\b2 samples ok"


def picture(width: int = 40, height: int = 30, mode: str = "RGB") -> Image.Image:
    ramp = np.add.outer(np.arange(height), np.arange(width)).astype(np.uint8) * 3
    return Image.fromarray(ramp).convert(mode)


def encoded(image: Image.Image, kind: str, **given: object) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **given)
    return file.getvalue()


def png(
    width: int,
    height: int,
    bits: int = 8,
    kind: int = 2,
    data: bytes = b"\0" * 999,
    *more: tuple[bytes, bytes],
) -> bytes:
    """A PNG whose header announces what it likes. more : chunks before the pixels."""

    def chunk(name: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )

    head = struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    chunks = [(b"IHDR", head), *more, (b"IDAT", zlib.compress(data, 1)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*c) for c in chunks)


def sparse(path: Path, size: int, start: bytes = b"") -> None:
    path.write_bytes(start)
    os.truncate(path, size)


def _files() -> Iterator[tuple[str, Callable[[Path], object]]]:
    """Images that are none: (name, what writes one)."""
    good = encoded(picture(), "PNG")
    jpeg = encoded(picture(), "JPEG")
    plain: dict[str, bytes] = {
        "empty": b"",
        "text": b"not an image",
        "a page": b"<html><script>alert(1)</script></html>",
        "control characters": b"\x1b[31m\x07\x1b]0;owned\x07",
        "PNG cut": good[: len(good) // 2],
        "PNG header only": good[:20],
        "JPEG cut": jpeg[: len(jpeg) // 2],
        "JPEG header only": jpeg[:10],
        "60,000 x 60,000": png(60_000, 60_000),
        "2^31 x 1": png(2**31 - 1, 1),
        "0 x 9": png(0, 9),
        "pixels missing": png(4000, 4000),
        "a bomb of 2 GB": png(12_000, 12_000, data=bytes(1 << 31)),
        "text chunk bomb": png(
            4, 4, 8, 2, bytes(52), (b"zTXt", b"k\0\0" + zlib.compress(bytes(1 << 28), 1))
        ),
        "profile bomb": png(
            4, 4, 8, 2, bytes(52), (b"iCCP", b"k\0\0" + zlib.compress(bytes(1 << 28), 1))
        ),
        "chunk of 4 GB": good[:33] + b"\xff\xff\xff\xffIDAT" + b"\0" * 99,
        "WebP cut": encoded(picture(), "WEBP")[:40],
        "GIF of 65,535 x 65,535": b"GIF89a\xff\xff\xff\xff\x80\0\0"
        + b"\0" * 6
        + b",\0\0\0\0\xff\xff\xff\xff\0\2\2L\1\0;",
        "BMP of 2^30 x 2^30": b"BM"
        + struct.pack("<IHHIIiiHHIIiiII", 99, 0, 0, 54, 40, 2**30, 2**30, 1, 24, 0, 0, 0, 0, 0, 0),
        "BMP of negative width": b"BM"
        + struct.pack("<IHHIIiiHHIIiiII", 99, 0, 0, 54, 40, -40, 30, 1, 24, 0, 0, 0, 0, 0, 0),
        "TIFF in a ring": b"II*\0\x08\0\0\0"
        + struct.pack("<HHHII", 1, 256, 4, 1, 40)
        + struct.pack("<I", 8),
        "TIFF of 2^31 strips": b"II*\0\x08\0\0\0"
        + struct.pack("<H", 3)
        + b"".join(
            struct.pack("<HHII", t, 4, n, 60) for t, n in ((256, 1), (257, 1), (273, 2**31 - 1))
        )
        + b"\0" * 99,
        "gzip": gzip.compress(good),
        "SVG": b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>',
        "PDF": b"%PDF-1.4\n%\xff\xff",
        "a zip": b"PK\x03\x04" + bytes(100),
        "an array": b"\x93NUMPY\x01\0v\0{'descr': '|O', 'shape': (1,)}",
    }
    for name, data in plain.items():
        yield name, lambda p, d=data: p.write_bytes(d)
    for size in (3, 20, 200):
        yield f"sparse JPEG, {size} GB", lambda p, s=size: sparse(p, s << 30, jpeg)
    yield "sparse PNG, 20 GB", lambda p: sparse(p, 20 << 30, good[:33])
    yield "sparse zeros, 20 GB", lambda p: sparse(p, 20 << 30)
    yield "sparse TIFF, 20 GB", lambda p: sparse(p, 20 << 30, encoded(picture(), "TIFF"))
    yield "a pipe", lambda p: os.mkfifo(p)
    yield "a device", lambda p: p.symlink_to("/dev/zero")
    yield "a link to nowhere", lambda p: p.symlink_to("nowhere")
    yield "a link to itself", lambda p: p.symlink_to(p.name)


def _maps() -> Iterator[tuple[str, str, Callable[[Path], object]]]:
    """Relative depth that is none: (name, ending, what writes one)."""
    numpy = b"\x93NUMPY\x01\0"

    def header(text: str) -> bytes:
        return numpy + struct.pack("<H", len(text)) + text.encode()

    forms = {
        "pickles": "{'descr': '|O', 'fortran_order': False, 'shape': (3, 4)}\n",
        "2^40 numbers": "{'descr': '<f4', 'fortran_order': False, 'shape': (1048576, 1048576)}\n",
        "2^50 numbers": "{'descr': '<f4', 'fortran_order': False, 'shape': (1125899906842624,)}\n",
        "negative shape": "{'descr': '<f4', 'fortran_order': False, 'shape': (-3, 4)}\n",
        "code": "__import__('os').system('touch owned')\n",
        "nested": "(" * 5000 + "\n",
        "5,000 digits": "{'descr': '<f4', 'fortran_order': False, 'shape': ("
        + "9" * 5000
        + ",)}\n",
        "text of 2^31": "{'descr': '<U2147483', 'fortran_order': False, 'shape': (3, 4)}\n",
        "records": "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (3, 4)}\n",
    }
    for name, text in forms.items():
        yield name, ".npy", lambda p, t=text: p.write_bytes(header(t) + bytes(400))
    yield "empty", ".npy", lambda p: p.write_bytes(b"")
    yield "a zip of arrays", ".npy", lambda p: np.savez(p.open("wb"), a=np.ones((30, 40)))
    for name, values in {
        "complex": np.ones((30, 40), complex),
        "3 axes": np.ones((3, 30, 40)),
        "dates": np.zeros((3, 4), "M8[s]"),
        "no numbers": np.ones((0, 40)),
        "all nan": np.full((30, 40), np.nan),
    }.items():
        yield name, ".npy", lambda p, v=values: np.save(p.open("wb"), v)
    yield (
        "sparse array of 20 GB",
        ".npy",
        lambda p: sparse(
            p,
            20 << 30,
            header("{'descr': '<f4', 'fortran_order': False, 'shape': (65536, 65536)}\n"),
        ),
    )
    yield "a pipe", ".npy", lambda p: os.mkfifo(p)
    yield "8 bits", ".png", lambda p: p.write_bytes(encoded(picture(), "PNG"))
    yield "60,000 x 60,000 map", ".png", lambda p: p.write_bytes(png(60_000, 60_000, 16, 0))
    yield "sparse map, 20 GB", ".png", lambda p: sparse(p, 20 << 30, png(40, 30, 16, 0)[:60])
    yield "map cut", ".png", lambda p: p.write_bytes(encoded(picture(mode="I;16"), "PNG")[:70])


def folder(box: Path, change: Callable[[Path], object], name: str = "bad.png") -> None:
    """Two good images, and one that is hostile, below box/in."""
    (box / "in").mkdir()
    for good in ("a.png", "z.png"):
        picture().save(box / "in" / good)
    change(box / "in" / name)


def depth(box: Path, change: Callable[[Path], object], place: str, ending: str) -> None:
    """Three good images with depth and relative depth, of which one is hostile."""
    for name in ("in/depth", "relative"):
        (box / name).mkdir(parents=True)
    for name in ("a", "bad", "z"):
        picture().save(box / "in" / f"{name}.png")
        Image.fromarray(np.full((30, 40), 2000, np.uint16)).save(box / "in/depth" / f"{name}.png")
        np.save(
            box / "relative" / f"{name}.npy", np.linspace(1, 2, 1200).reshape(30, 40).astype("f4")
        )
    for path in box.glob(f"{place}/bad.*"):
        path.unlink()
    change(box / place / f"bad{ending}")


def attacks(world: World) -> Iterator[Attack]:
    yield Attack(
        "control: three good images",
        EMBED,
        lambda box: folder(box, lambda p: picture().save(p)),
        may=ACCEPTED,
        says="3 samples ok",
    )
    for name, make in _files():
        yield Attack(
            f"image: {name}", EMBED, lambda box, m=make: folder(box, m), may=FAILED, says=OTHERS
        )
    # A decompressing library may give the picture without the chunk that is hostile.
    for name in (
        "\x1b[31mred",
        "a\nb",
        "a\tb",
        "'; rm -rf x",
        "\u202egnp",
        "x" * 240,
        "--option",
        "%s%n",
        "\x9b2J",
    ):
        yield Attack(
            f"image's name: {ascii(name)[:20]}",
            EMBED,
            lambda box, n=name: folder(box, lambda p: p.write_bytes(b"x"), f"{n}.png"),
            may=CONTAINED,
        )
    yield Attack(
        "image's name: not UTF-8",
        EMBED,
        lambda box: folder(box, lambda p: Path(os.fsdecode(b"in/\xff\xfe.png")).touch()),
        may=CONTAINED,
    )
    yield Attack(
        "control: depth",
        DEPTH,
        lambda box: depth(box, lambda p: np.save(p, np.eye(30, 40)), "relative", ".npy"),
        may=ACCEPTED,
    )
    for place in ("relative", "in/depth"):
        for name, ending, make in _maps():
            if place == "in/depth" and (name in ("all nan",)):
                continue
            yield Attack(
                f"{place.rpartition('/')[2]}: {name}",
                DEPTH,
                lambda box, m=make, e=ending, p=place: depth(box, m, p, e),
                may=FAILED,
                says=OTHERS,
                check=lambda box, said: "it ran code" if (box / "owned").exists() else None,
            )
    words = ("show", "own/train/bad", "--work", "work", "--out", "nowhere/x.png")
    yield Attack("show: nothing there", words, lambda box: (box / "work").mkdir())
    for name, make in list(_files())[:12]:
        yield Attack(
            f"predict: {name}",
            (
                "predict",
                "--work",
                "work",
                "--head",
                "head",
                "--image",
                "in/bad.png",
                "--caption",
                "a bed",
                "--relative",
                "r.npy",
                "--out",
                "o.ply",
            ),
            lambda box, m=make: (
                world.copy(box),
                folder(box, m),
                np.save(box / "r.npy", np.ones((30, 40))),
            ),
        )
