"""Names that become folders of a work dir: datasets, tables, heads. They are checked here only."""

from ..common.errors import UsageError

# What a work dir keeps beside its datasets; nothing of the user's has such a name.
KEPT = ("heads", "comparisons", "logs")

# Bytes of UTF-8; file systems take 255, and names of temporary files are longer.
_LONGEST = 200


def is_name(name: str) -> bool:
    """Whether a folder of a work dir can have that name on every file system and object store.

    Not: separators, `..`, control characters, nothing at all, and names that begin with `_` or
    `.`, which mark helper files, or with `~`, which shells take for a home.
    """
    plain = name.isprintable() and not set(name) & set('/\\:*?"<>|')
    ends = name[:1] not in ("", "_", ".", "~", "-", " ") and name[-1] not in (".", " ")
    return plain and ends and len(name.encode("utf-8", "replace")) <= _LONGEST


def plain_name(choice: str) -> str:
    """The name that tables of a choice have: module-attribute for `module:attribute`."""
    return choice.replace(":", "-")


def check_name(what: str, name: str) -> str:
    """The name itself if `is_name` and not in KEPT, else a UsageError that begins with `what`."""
    if check_plain(what, name) in KEPT:
        raise UsageError(
            f"{what}: expected another name than {', '.join(KEPT)}, which a work dir keeps for "
            f"itself; found {name!r}"
        )
    return name


def check_plain(what: str, name: str) -> str:
    """The name itself if `is_name`, else a UsageError that begins with `what`."""
    if not is_name(name):
        raise UsageError(
            f"{what}: expected a plain name: no '/', ':' or the like in it, not beginning with "
            f"'_', '.', '~' or '-'; found {name!r:.80}"
        )
    return name


def check_dataset_name(name: str) -> str:
    """The name itself, if a dataset can have it; raises UsageError, see `check_name`."""
    return check_name("dataset", name)


def head_folder(name: str) -> str:
    """The folder of a head in a work dir; raises UsageError, see `check_name`."""
    return f"heads/{check_name('head', name)}"


def comparison_folder(name: str) -> str:
    """The folder of a comparison in a work dir; raises UsageError, see `check_name`."""
    return f"comparisons/{check_name('comparison', name)}"
