"""The heads of a work dir, as status and verify see them."""

from collections.abc import Iterator

from .. import registry
from ..common.errors import RsaDataError
from ..datasets import index
from ..runner.collection import Collection
from ..store.tables import WorkDir, fingerprint
from .description import parse


def names(work: WorkDir) -> list[str]:
    """Names of the heads, but for those whose training has not ended."""
    names = [name[:-1] for name in work.store.list("heads") if name.endswith("/")]
    return [name for name in names if _ended(work, name)]


def _ended(work: WorkDir, name: str) -> bool:
    try:
        files = work.store.list(f"heads/{name}")
    except RsaDataError:
        return True  # `check` and `state` say what is wrong with it
    weights = "head.safetensors" in files and "checkpoint.safetensors" not in files
    return "head.json" in files or weights


def state(work: WorkDir, name: str) -> str:
    """Whether the tables that a head was trained on are still the same ones, or ""."""
    try:
        where = f"heads/{name}/head.json"
        description = parse(work.store.read(where) or b"{}", where)
    except RsaDataError as error:
        return f"damaged: {error}"
    changed = []
    for dataset, about in description.get("datasets", {}).items():
        if dataset not in work.datasets():
            continue
        try:
            splits = index.load_dataset(work, dataset).test_splits
        except RsaDataError:
            continue  # a dataset of a package that is not installed here
        samples = work.table(dataset, "samples")
        numbers = [n for n in samples.parts() if samples.receipt(n).split not in splits]
        for table_name, digest in about.get("tables", {}).items():
            table = work.table(dataset, table_name)
            there = set(table.parts())
            digests = [table.receipt(n).digest for n in numbers if n in there]
            if fingerprint(digests) != digest:
                changed.append(table.path)
    return f"out of date: trained before {', '.join(changed)} changed" if changed else ""


def check(work: WorkDir, name: str) -> Iterator[str]:
    """Problems of a head, and of what was measured with it."""
    from .checks import problems

    yield from problems(work, name)
    evaluations = registry.resolve("room", registry.UPWARDS, "evaluations")
    for kind in ("evaluation", "robustness"):
        yield from evaluations(work, f"heads/{name}/{kind}")


HEADS = Collection(names, check, state)
