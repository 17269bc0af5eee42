"""The command that opens a page to try a head: play."""

from pathlib import Path

import click

from ..common.extras import extras
from ..store.tables import WorkDir
from .shared import work_option


@click.command()
@work_option
@click.option("--head", default="head", show_default=True, help="Head of the work dir.")
@click.option(
    "--encoder-weights", type=click.Path(path_type=Path), help="File of the text encoder's weights."
)
@click.option("--segments", metavar="SOURCE", help="Segmentation model for your own photos.")
@click.option("--segmenter-weights", type=click.Path(path_type=Path), help="File of its weights.")
@click.option(
    "--card", type=click.Path(path_type=Path), help="Model card (TOML) of your own model."
)
@click.option(
    "--depth-weights", type=click.Path(path_type=Path), help="File of the depth model's weights."
)
@click.option(
    "--port",
    default=8080,
    show_default=True,
    help="Port of the page; it is served to this machine only.",
)
@click.option("--show/--no-show", default=True, help="Open the page in the browser.")
def play(
    work: str,
    head: str,
    encoder_weights: Path | None,
    segments: str | None,
    segmenter_weights: Path | None,
    card: Path | None,
    depth_weights: Path | None,
    port: int,
    show: bool,
) -> None:
    """Try a head in the browser.

    The page shows a photo, its caption, metric depth, a 3-D view and distances.

    \b
      rsa-data play --work demo --head demo
    """
    from ..views.playground import desk

    with extras("rsa-data play"):
        from ..views.playground import page
    models = desk.load(
        WorkDir(work), head, encoder_weights, segments=segments,
        segmenter_weights=segmenter_weights, card=card, depth_weights=depth_weights,
    )  # fmt: skip
    click.echo(f"head {head}: http://127.0.0.1:{port} (Ctrl-C ends it)")
    page.serve(models, port, show)
