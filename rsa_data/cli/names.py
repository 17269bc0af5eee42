"""The command `list`; what it lists is read from sources and cards, so that it answers at once."""

from collections.abc import Callable

import click

from .. import registry
from ..common import class_names, options
from ..common.errors import unknown
from ..datasets import guide
from ..runner import pipeline_docs


@click.command("list")
@click.argument("what", required=False)
@click.argument("name", required=False)
def list_names(what: str | None, name: str | None) -> None:
    """List the names that options take.

    WHAT is one of datasets, segmenters, decoders, class-tables, styles, tokenizers, encoders,
    image-encoders, depth-models, heads, losses and jobs; all of them by default. With the NAME of a
    dataset: where to get it, how its files must lie, and its options.

    \b
      rsa-data list datasets
      rsa-data list datasets nyuv2
    """
    if what is not None and what not in _KINDS:
        raise unknown("kind", what, _KINDS)
    if name is not None and what is not None:
        _one(what, name)
        return
    for kind in [what] if what else _KINDS:
        click.echo(f"{kind}:")
        for name, doc in _KINDS[kind]():
            click.echo(f"  {name:28} {doc}")
            if what == "datasets":
                for line in _dataset_options(name):
                    click.echo(f"  {'':28}   {line}")
    if what == "datasets":
        click.echo("Where to get one and how its files must lie: rsa-data list datasets NAME")


def _one(what: str, name: str) -> None:
    """All that is known of one name."""
    known = dict(_KINDS[what]())
    if name not in known:
        raise unknown(what.rstrip("s"), name, known)
    click.echo(f"{name}: {known[name]}")
    if what == "datasets":
        click.echo(guide.section(name))
        click.echo("options (--dataset-option NAME=VALUE):")
        for line in _dataset_options(name):
            click.echo(f"  {line}")


def _dataset_options(name: str) -> list[str]:
    """What --dataset-option takes for a dataset, one line an option."""
    build = registry.resolve("dataset", registry.DATASETS, name)
    return [
        f"{option}={'...' if p.default in (None, p.empty) else p.default}: "
        f"{options.help_text(build, option)}"
        for option, p in options.parameters(build).items()
    ]


_KINDS: dict[str, Callable[[], list[tuple[str, str]]]] = {
    "datasets": lambda: registry.described(registry.DATASETS),
    "segmenters": lambda: registry.described(registry.SEGMENTERS),
    "decoders": lambda: registry.described(registry.DECODERS),
    "class-tables": class_names.described,
    "styles": lambda: registry.described(registry.STYLES),
    "tokenizers": lambda: registry.described(registry.TOKENIZERS),
    "encoders": lambda: registry.described(registry.ENCODERS),
    "image-encoders": lambda: registry.described(registry.IMAGE_ENCODERS),
    "depth-models": lambda: registry.described(registry.DEPTH_MODELS),
    "heads": lambda: registry.described(registry.HEADS),
    "losses": lambda: registry.described(registry.LOSSES),
    "metrics": lambda: registry.described(registry.METRICS),
    "protocols": lambda: registry.described(registry.PROTOCOLS),
    "jobs": pipeline_docs.described,
}
