"""Text that people write: captions to import, lists of files, prompts, pipeline files."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from .harness import ACCEPTED, ANY, CONTAINED, REFUSED, Attack
from .images import folder, picture, sparse
from .workdir import JUNK
from .world import World

INDEX = (
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

_NOISE: dict[str, bytes] = {
    "not UTF-8": b"\xff\xfe\xff",
    "NUL": b"a.png\0\nz.png",
    "control characters": b"\x1b[31ma.png\n\x07",
    "out of the folder": b"../../etc/passwd",
    "absolute": b"//etc/passwd",
    "a name of 5,000 letters": b"x" * 5000,
    "empty": b"",
    "UTF-16": "a.png\n".encode("utf-16"),
    "no such image": b"nowhere.png",
}

# A dataset of images that lie in `in`.
_OWN = b'[dataset.a]\nbuilder = "folder"\nroot = "in"\n'

_PIPELINES: dict[str, bytes] = {
    "empty": b"",
    "not TOML": b"[[[",
    "not UTF-8": b"\xff",
    "nested": b"a = " + b"[" * 100_000,
    "inline tables": b"a = " + b"{a=" * 5000,
    "5,000 digits": b"[captions]\nseed = " + b"9" * 5000,
    "dotted": b".".join([b"a"] * 20_000) + b" = 1",
    "a table of tables": b"[" + b".".join([b"dataset"] * 3000) + b"]",
    "dataset 3": b"dataset = 3",
    "stage 3": b"captions = 3",
    "an unknown stage": b"[dataset.a]\n[bogus]\n",
    "a dataset named ..": b'[dataset."../esc"]\nbuilder = "folder"\nroot = "in"\n',
    "a dataset named by control characters": _OWN.replace(b".a", b'."a\\u001b[31m"'),
    "a builder that runs": b'[dataset.a]\nbuilder = "os:system"\nroot = "in"\n',
    "a root list": b'[dataset.a]\nbuilder = "folder"\nroot = [1]\n',
    "an unknown option": _OWN + b"[captions]\nbogus = 1\n",
    "an option of another kind": _OWN + b'[captions]\nvariants = "many"\n',
    "nan": _OWN + b"[captions]\ndelete = nan\n",
    "a date": b'[dataset.a]\nbuilder = "folder"\nroot = 1979-05-27\n',
    "doc 3": b"doc = 3",
    "doc of control characters": b'doc = "\\u001b[31mx\\u0007"\n[bogus]\n',
    "a head named ..": _OWN + b'[[train-head]]\nname = "../../x"\n',
}


def _captions(box: Path, data: bytes, name: str) -> None:
    folder(box, lambda p: picture().save(p))
    (box / name).write_bytes(data)


def attacks(world: World) -> Iterator[Attack]:
    words = ("captions", "--work", "work", "--dataset", "folder:own", "--root", "in", "--style")
    good = b'{"a": "a bed", "bad": "two beds", "z": "three"}'
    yield Attack(
        "control: import",
        (*words, "import:c.json"),
        lambda b: _captions(b, good, "c.json"),
        may=ACCEPTED,
    )
    for name, data in JUNK.items():
        yield Attack(
            f"captions json: {name}",
            (*words, "import:c.json"),
            lambda b, d=data: _captions(b, d, "c.json"),
        )
    csv: dict[str, bytes] = {
        "no header": b"a,b\nc,d\n",
        "a field of 10 MB": b"key,text\na," + b"x" * 10_000_000,
        "an open quote": b'key,text\na,"x\n' + b"y\n" * 10_000,
        "NUL": b"key,text\na,\0\n",
        "not UTF-8": b"key,text\na,\xff\n",
        "columns missing": b"key,text\na\n",
        "return only": b"key,text\ra,b\r",
    }
    for name, data in csv.items():
        fine = name in ("a field of 10 MB", "return only", "NUL")
        yield Attack(
            f"captions csv: {name}",
            (*words, "import:c.csv"),
            lambda b, d=data: _captions(b, d, "c.csv"),
            may=ANY if fine else REFUSED,
        )
    for ending in (".json", ".csv"):
        yield Attack(
            f"captions{ending}: 20 GB",
            (*words, f"import:c{ending}"),
            lambda b, e=ending: (
                _captions(b, b"", f"c{e}"),
                sparse(b / f"c{e}", 20 << 30, b"key,text\n"),
            ),
        )
        yield Attack(
            f"captions{ending}: a pipe",
            (*words, f"import:c{ending}"),
            lambda b, e=ending: (folder(b, lambda p: picture().save(p)), os.mkfifo(b / f"c{e}")),
        )

    def texts(box: Path, make: Callable[[Path], object]) -> None:
        folder(box, lambda p: picture().save(p))
        (box / "texts").mkdir()
        (box / "texts/a.txt").write_text("a bed")
        make(box / "texts/bad.txt")

    for name, make in {
        "20 GB": lambda p: sparse(p, 20 << 30, b"a"),
        "a pipe": lambda p: os.mkfifo(p),
        "a folder": lambda p: p.mkdir(),
        "not UTF-8": lambda p: p.write_bytes(b"\xff"),
        "/dev/zero": lambda p: p.symlink_to("/dev/zero"),
    }.items():
        yield Attack(
            f"captions folder: {name}",
            (*words, "import:texts"),
            lambda b, m=make: texts(b, m),
            # A folder is no text of an image, whatever its name; that images have none is said.
            may=ACCEPTED if name == "a folder" else CONTAINED,
            says="2 images have no text" if name == "a folder" else None,
        )
    yield Attack(
        "a caption of control characters",
        ("predict", "--work", "work", "--caption", "\x1b[31m\x07 a bed\u202e", "--head", "head"),
        lambda b: world.copy(b),
        may=ANY,
    )
    yield Attack(
        "a caption of 10 MB",
        ("predict", "--work", "work", "--captions", "c.txt", "--head", "head"),
        lambda b: (world.copy(b), (b / "c.txt").write_text("bed " * 2_500_000)),
        may=ANY,
        deadline=100,
    )
    for name, make in {
        "20 GB": lambda p: sparse(p, 20 << 30, b"a\n"),
        "a pipe": lambda p: os.mkfifo(p),
        "/dev/zero": lambda p: p.symlink_to("/dev/zero"),
        "not UTF-8": lambda p: p.write_bytes(b"\xff\xfe"),
        "empty": lambda p: p.write_bytes(b""),
        "a folder": lambda p: p.mkdir(),
        "nothing there": lambda p: None,
    }.items():
        yield Attack(
            f"predict --captions: {name}",
            ("predict", "--work", "work", "--captions", "c.txt", "--head", "head"),
            lambda b, m=make: (world.copy(b), m(b / "c.txt")),
        )
    for option in ("file_list", "test_list"):
        listed = (*INDEX, "--dataset-option", f"{option}=l.txt")
        for name, data in _NOISE.items():
            fine = option == "file_list" and name in ("no such image", "control characters")
            yield Attack(
                f"{option}: {name}",
                listed,
                lambda b, d=data: (
                    folder(b, lambda p: picture().save(p)),
                    (b / "l.txt").write_bytes(d),
                ),
                may=ANY
                if (option, name) == ("test_list", "empty")
                else CONTAINED
                if fine
                else REFUSED,
            )
        yield Attack(
            f"{option}: 20 GB",
            listed,
            lambda b: (
                folder(b, lambda p: picture().save(p)),
                sparse(b / "l.txt", 20 << 30, b"a.png\n"),
            ),
        )
        yield Attack(
            f"{option}: a pipe",
            listed,
            lambda b: (folder(b, lambda p: picture().save(p)), os.mkfifo(b / "l.txt")),
        )
    for name, data in {
        **_NOISE,
        "zeros": b"0 0 0\n0 0 0\n0 0 0",
        "nan": b"nan 0 1\n0 nan 1\n0 0 1",
        "5,000 digits": b"9" * 5000 + b" 0 1\n0 1 1\n0 0 1",
    }.items():
        yield Attack(
            f"intrinsics: {name}",
            (*INDEX, "--dataset-option", "intrinsics=k.txt"),
            lambda b, d=data: (
                folder(b, lambda p: picture().save(p)),
                (b / "in/k.txt").write_bytes(d),
            ),
            may=REFUSED,
        )
    for name, data in _PIPELINES.items():
        yield Attack(
            f"pipeline: {name}",
            ("run", "p.toml", "--work", "work"),
            lambda b, d=data: (
                folder(b, lambda p: picture().save(p)),
                (b / "p.toml").write_bytes(d),
            ),
            check=lambda b, said: "it wrote outside" if (b / "esc").exists() else None,
        )
    yield Attack(
        "pipeline: 20 GB", ("run", "p.toml"), lambda b: sparse(b / "p.toml", 20 << 30, b"a = 1\n")
    )
    yield Attack("pipeline: a pipe", ("run", "p.toml"), lambda b: os.mkfifo(b / "p.toml"))
    yield Attack("pipeline: a folder", ("run", "p.toml"), lambda b: (b / "p.toml").mkdir())
    known = ("predict", "--work", "work", "--caption", "a bed", "--relative", "r.npy", "--known")
    for point in (
        "1,1,nan",
        "1,1,-3",
        "1,1,inf",
        "1,1,1e400",
        "99999,1,2",
        "-1,1,2",
        "x,y,z",
        "1,2",
        "1,1,0",
        "",
        "9" * 5000 + ",1,2",
    ):
        yield Attack(
            f"--known {point[:20]!r}",
            (*known, point),
            lambda b: (
                world.copy(b),
                np.save(b / "r.npy", np.random.default_rng(0).random((30, 40))),
            ),
            mistakes=True,
        )
