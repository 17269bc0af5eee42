"""What a person must read beside a dataset's numbers: that its images were rendered."""

from collections.abc import Iterable

from ..store.tables import WorkDir


def is_synthetic(work: WorkDir, name: str) -> bool:
    """Whether a dataset of a work dir was rendered by this program, whatever it is called there."""
    about = work.table(name, "samples").description()
    return str(about.options.get("dataset", "")).startswith("synthetic")


def synthetic_of(work: WorkDir, names: Iterable[str]) -> frozenset[str]:
    """Those of the datasets that were rendered."""
    return frozenset(name for name in names if is_synthetic(work, name))


def shown(name: str, synthetic: bool) -> str:
    """A dataset's name where its numbers stand."""
    return f"{name} (synthetic)" if synthetic and "synthetic" not in name else name


def note(synthetic: Iterable[str]) -> list[str]:
    """A sentence on datasets that were rendered; none where there is none."""
    names = sorted(synthetic)
    if not names:
        return []
    return [
        f"Synthetic: {', '.join(names)} {'was' if len(names) == 1 else 'were'} rendered, not "
        "photographed: these numbers say nothing about real images."
    ]
