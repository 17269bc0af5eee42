"""The command that opens a page to try a head: play."""

from pathlib import Path

import click

from ..common.extras import extras
from ..store.tables import WorkDir
from .shared import work_option


@click.command()
@work_option
@click.option("--head", default="head", show_default=True, help="Name of a head of the work dir.")
@click.option("--weights", type=click.Path(path_type=Path), help="File of the text encoder.")
@click.option("--segmenter", help="What finds objects in your own pictures.")
@click.option("--segmenter-model", type=click.Path(path_type=Path), help="File of its weights.")
@click.option("--depth-weights", type=click.Path(path_type=Path), help="File of the depth model.")
@click.option("--port", default=8080, show_default=True, help="Of the page, on this machine only.")
@click.option("--show/--no-show", default=True, help="Open it in the browser.")
def play(
    work: str,
    head: str,
    weights: Path | None,
    segmenter: str | None,
    segmenter_model: Path | None,
    depth_weights: Path | None,
    port: int,
    show: bool,
) -> None:
    """Try a head in the browser: a picture, a caption, metric depth, distances.

    \b
      rsa-data play --work demo --head demo
    """
    from ..views.playground import desk

    with extras("rsa-data play"):
        from ..views.playground import page
    models = desk.load(
        WorkDir(work), head, weights, segmenter=segmenter, segmenter_model=segmenter_model,
        depth_weights=depth_weights,
    )  # fmt: skip
    click.echo(f"head {head}: http://127.0.0.1:{port} (Ctrl-C ends it)")
    page.serve(models, port, show)
