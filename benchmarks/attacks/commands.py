"""The command line itself: words that make no sense, places that cannot be written."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .harness import ANY, REFUSED, Attack
from .images import folder, picture
from .world import World

EMBED = (
    "embed-images",
    "--work",
    "work",
    "--root",
    "in",
    "--encoder",
    "thumbnail",
)

# Names of datasets and heads that lead out of the work dir, hide in it, or are its own.
NAMES = (
    "../esc",
    "..",
    ".",
    "/esc",
    "a/b",
    "a/../b",
    "",
    " ",
    ".hidden",
    "_private",
    "heads",
    "logs",
    "comparisons",
    "a\nb",
    "a\x1b[31m",
    "a\\b",
    "x" * 300,
    "a:b",
    "\u202ea",
    "~",
    "-x",
    "a\x7f",
)

OPTIONS = (
    "--part-range ²:³",
    "--part-range 3:1",
    "--part-range -1:2",
    "--part-range a:b",
    "--part-range 5",
    "--workers 0",
    "--workers -3",
    "--workers x",
    "--workers 1e3",
    "--memory-limit 0",
    "--memory-limit -4GB",
    "--memory-limit nan",
    "--memory-limit 4XB",
    "--max-failures 200%",
    "--max-failures -1",
    "--max-failures nan%",
    "--max-failures x",
    "--engine bogus",
    "--split bogus",
    "--dataset-option x",
    "--dataset-option bogus=1",
    "--dataset-option part_size=0",
    "--dataset-option part_size=9999999999999999999999",
    "--dataset-option test_share=nan",
    "--dataset-option test_share=2",
    "--dataset-option min_depth=nan",
    "--dataset-option intrinsics=nan,1,1,1",
    "--dataset-option depth=depth",
    "--threads 0",
    "--threads -1",
    "--threads 99999999999999999999",
    "--precision bogus",
    "--store bogus",
    "--device bogus",
    "--bogus",
    "--root",
    "--ray-address x --engine bogus",
)

CAPTIONS = (
    "--variants 0",
    "--variants -1",
    "--variants 99999999999999999999",
    "--delete nan",
    "--delete 2",
    "--delete -1",
    "--digits 9",
    "--digits -1",
    "--seed 1e400",
    "--replace nan",
    "--insert -1",
    "--max-tokens -5",
    "--style bogus",
    "--style vlm",
    "--style import:",
    "--style import:nowhere",
    "--tokenizer bogus",
    "--tokenizer hf:../../x",
    "--concurrency 0 --style vlm:x --endpoint http://127.0.0.1:1",
    "--style vlm:x --endpoint http://127.0.0.1:1 --rate nan",
    "--style vlm:x --endpoint http://127.0.0.1:1 --prices x",
)

# Not --pixels 0 and, above, --max-tokens 0, which say "all pixels" and "no limit".
TRAIN = (
    "--epochs 0",
    "--epochs -1",
    "--lr nan",
    "--lr -1",
    "--lr inf",
    "--batch 0",
    "--batch -1",
    "--validation nan",
    "--validation 2",
    "--validation -1",
    "--clip nan",
    "--clip -1",
    "--weight-decay nan",
    "--memory 0",
    "--memory nan",
    "--threads 0",
    "--seed -1",
    "--head bogus",
    "--head os:system",
    "--loss bogus",
    "--style bogus",
    "--encoder bogus",
    "--depth-model bogus",
    "--datasets bogus",
    "--warmup nan",
    "--patience -1",
    "--end-lr nan",
)


def attacks(world: World) -> Iterator[Attack]:
    def pictures(box: Path) -> None:
        folder(box, lambda p: picture().save(p))

    def stray(box: Path, said: str) -> str | None:
        outside = {p.name for p in box.iterdir()} - {"in", "work", "scenes"}
        above = {p.name for p in box.parent.iterdir()} - {"box", "tmp", "said", "cache", ".cache"}
        inside = (
            {p.name for p in (box / "work").glob("heads/*")} if (box / "scenes").exists() else set()
        )
        found = outside | above | (inside - {"head"})
        return f"it wrote {sorted(found)}" if found else None

    for name in NAMES:
        if name:
            yield Attack(
                f"dataset {ascii(name)[:24]}",
                (*EMBED, "--dataset", f"folder:{name}"),
                pictures,
                check=stray,
                mistakes=True,
            )
        yield Attack(
            f"head {ascii(name)[:24]}",
            ("train-head", "--work", "work", "--head", "linear", "--epochs", "1", "--name", name),
            lambda b: world.copy(b),
            check=stray,
            mistakes=True,
        )
    for words in OPTIONS:
        yield Attack(
            f"embed-images {words}",
            (*EMBED, "--dataset", "folder:own", *words.split()),
            pictures,
            mistakes=True,
        )
    for words in CAPTIONS:
        yield Attack(
            f"captions {words}",
            (
                "captions",
                "--work",
                "work",
                "--dataset",
                "synthetic-indoor",
                "--start-over",
                *words.split(),
            ),
            lambda b: world.copy(b),
            mistakes=True,
        )
    for words in TRAIN:
        yield Attack(
            f"train-head {words}",
            (
                "train-head",
                "--work",
                "work",
                "--name",
                "x",
                *(() if "--epochs" in words else ("--epochs", "1")),
                *words.split(),
            ),
            lambda b: world.copy(b),
            mistakes=True,
        )
    for words in (
        "bogus",
        "--bogus",
        "list bogus",
        "predict",
        "predict --caption x --head nowhere",
        "evaluate --head nowhere",
        "evaluate --draws -1",
        "evaluate --protocol bogus",
        "evaluate --external x",
        "evaluate --external a=/nowhere",
        "evaluate --beside nowhere",
        "compare --seeds 0",
        "compare --name ../x --epochs 1",
        "compare --inputs x",
        "compare --subsets nowhere",
        "robustness --head nowhere",
        "show nowhere",
        "show synthetic-indoor/test/nowhere",
        "export --out work",
        "export --out /proc/x",
        "export --out o --datasets nowhere",
        "export --out o --embeddings ../x",
        "report --out /proc/x.html",
        "report --samples -1",
        "report --out work",
        "import-head nowhere.pt",
        "import-head work --name x",
        "verify --recompute -1",
        "verify --recompute x",
        "plan bogus",
        "plan run nowhere",
        "run nowhere",
        "run demo --set x",
        "run demo --set bogus.x=1",
        "run demo --root x",
        "play --port 99999 --no-show",
        "play --head nowhere --no-show",
        "predict --head head --caption x --out /proc/x.npy",
        "retry-failed --dataset nowhere",
        "embed --encoder bogus",
        "embed --encoder hf:../../x",
        "embed --encoder-weights nowhere",
        "embed --dataset ../x",
        "depth --dataset synthetic-indoor --depth-model bogus",
        "predict --head head --image nowhere.png",
        "predict --head head --caption x --range 3,1",
        "predict --head head --caption x --known 1,1,1",
        "show synthetic-indoor/../x",
        "detect --dataset bogus",
        "detect --dataset synthetic-indoor --segments bogus",
    ):
        placed = () if words.split()[0] in ("bogus", "--bogus", "list") else ("--work", "work")
        yield Attack(words, (*words.split(), *placed), lambda b: world.copy(b), mistakes=True)
    yield from _places(world)
    yield from _outputs(world)


def _outputs(world: World) -> Iterator[Attack]:
    """Outputs over what is read, or in the middle of a work dir."""

    def prepare(box: Path) -> None:
        world.copy(box)
        (box / "maps").mkdir()
        (box / "photos").mkdir()
        picture().save(box / "photos" / "a.png")
        np.save(box / "maps" / "a.npy", np.ones((picture().height, picture().width), np.float32))
        (box / "README.md").write_text("of something else")

    predict = "predict photos --head head --caption x --relative maps"
    for words, says in {
        f"{predict} --out photos --kind png": "not read in the same call",
        f"{predict} --out maps": "not read in the same call",
        f"{predict} --out work/heads/head": "outside of the tables and heads",
        f"{predict} --out work/synthetic-indoor/samples": "outside of the tables and heads",
        "report --out work/heads/head/r.html": "outside of the tables and heads",
        "report --out photos/a.png": "a name that ends in .html",
        "show synthetic-indoor/test/00000_0 --out work/heads/head/a.png": "outside of the tables",
        "export --out work/heads/head/new": "outside of the tables and heads",
        "export-head head work/heads/head": "outside of the tables and heads",
        "export-head head .": "expected a new folder",
    }.items():
        placed = (*words.split(), "--work", "work")
        yield Attack(f"over what is there: {words}", placed, prepare, may=REFUSED, says=says)
    for name in ("", "work\udcff"):
        yield Attack(f"--work {name!r}", ("status", "--work", name), says="a folder in UTF-8")
    odd = ("predict", "--head", "head", "--caption", "a\udcff", "--work", "work")
    yield Attack("a caption that is no UTF-8", odd, lambda b: world.copy(b), says="expected UTF-8")


def _places(world: World) -> Iterator[Attack]:
    whole = world.copy
    for words in (
        "status",
        "verify",
        "list",
        "list datasets",
        "--help",
        "captions --help",
        "export --out o",
        "report --out r.html",
    ):
        split = words.split()
        placed = () if split[0] in ("list", "--help") or "--help" in split else ("--work", "work")
        yield Attack(
            f"{words} > /dev/full",
            (*split, *placed),
            lambda b: whole(b),
            stdout="/dev/full",
            may=REFUSED,
        )

    for words in (
        "train-head --name x --head linear --epochs 1",
        "report --out r.html",
        "export --out o",
    ):
        yield Attack(
            f"{words}: a file where its folder goes",
            (*words.split(), "--work", "work"),
            lambda b: (
                whole(b),
                (b / "o").write_text("x"),
                (b / "r.html").mkdir(),
                (b / "work/heads/x").write_text("x"),
            ),
        )
    yield Attack("a working folder that is gone", ("status", "--work", "../gone/work"), may=REFUSED)
    yield Attack(
        "PYTHONIOENCODING=ascii",
        ("list", "heads"),
        environment={"PYTHONIOENCODING": "ascii", "LC_ALL": "C"},
        may=ANY,
    )
    for limits in ("x", "image=", "image=-1", "image=nan", "bogus=3", "image=1XB", "request=0s"):
        yield Attack(
            f"RSA_DATA_LIMITS={limits}",
            (*EMBED, "--dataset", "folder:own"),
            lambda b: folder(b, lambda p: picture().save(p)),
            environment={"RSA_DATA_LIMITS": limits},
        )
    yield Attack(
        "RSA_DATA_OWN_ROOT of nowhere",
        ("embed-images", "--work", "work", "--dataset", "folder:own"),
        environment={"RSA_DATA_OWN_ROOT": "gopher://x"},
    )
