"""The command that opens a page to try a head: play."""

from typing import Annotated, Any

import click
import msgspec

from ..common.extras import extras
from ..common.options import call, parameters
from ..heads.predict.choices import Models, View
from ..store.tables import WorkDir
from .options import Number, click_options
from .shared import work_option


def _models(*, models: Models = Models(), view: View = View()) -> tuple[Models, View]:
    return models, view


@click.command()
@work_option
@click.option("--head", help="Head, as in `predict`; by default the work dir's own.")
@click_options(_models, hidden=("relative",))
@click.option(
    "--port",
    default=8080,
    type=Number(Annotated[int, msgspec.Meta(ge=1, lt=2**16)]),
    show_default=True,
    help="Port of the page; it is served to this machine only.",
)
@click.option("--show/--no-show", default=True, help="Open the page in the browser.")
def play(work: str, head: str | None, port: int, show: bool, **options: Any) -> None:
    """Try a head in the browser.

    The page shows a photo, its caption, metric depth, a 3-D view and distances.

    \b
      rsa-data play --work work/demo --head demo
    """
    from ..views.playground import desk

    with extras("rsa-data play"):
        from ..views.playground import page
    given = {name: options[name] for name in parameters(_models) if name in options}
    models = desk.load(WorkDir(work), head, *call(_models, **given))
    click.echo(f"head {models.name}: http://127.0.0.1:{port} (Ctrl-C ends it)")
    page.serve(models, port, show)
