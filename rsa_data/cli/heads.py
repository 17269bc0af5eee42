"""Commands that make and use heads: train-head, evaluate, predict, import-head, export-head."""

import json
import shlex
from pathlib import Path
from typing import Any

import click

from ..common.errors import RsaDataError, UsageError
from ..common.options import call, parameters
from ..evaluation.evaluate import evaluate as evaluate_function
from ..heads.description import parse
from ..heads.import_head import import_head as import_function
from ..heads.predict.predict import predict as predict_function
from ..heads.reading import reads
from ..heads.train.train_head import train_head as train_head_function
from ..heads.travel import export_head as export_function
from ..store.tables import WorkDir
from ..views.depth_files.write import Outputs, Writer, check
from . import console
from .options import click_options
from .shared import say_next, work_option

# A caption of the release's structured texts, for heads of which no captions are known.
_CAPTION = "An image with a bed, a wall, and two pillows."


def example_caption(work: WorkDir, head: str) -> str:
    """A caption that the head knows, quoted for a shell: the first one of its training set."""
    about = parse(work.store.read(f"heads/{head}/head.json") or b"{}", f"heads/{head}/head.json")
    for dataset, used in (about.get("datasets") or {}).items():
        for name in used.get("tables") or ():
            table = work.table(dataset, name)
            if name.startswith("captions/") and (parts := table.parts()):
                texts = table.read(parts[0], ["text"])["text"]
                return shlex.quote(str(texts[0])) if len(texts) else shlex.quote(_CAPTION)
    return shlex.quote(_CAPTION)


def use(work: WorkDir, head: str) -> str:
    """The command that shows what a head says: of a caption, or in the report where it needs a
    photo."""
    about = parse(work.store.read(f"heads/{head}/head.json") or b"{}", f"heads/{head}/head.json")
    if not {"text", "objects"}.issuperset(reads(about)):
        return "report"
    return f"predict --head {head} --caption {example_caption(work, head)}"


@click.command("train-head")
@work_option
@click_options(train_head_function)
def train_head(work: str, **options: Any) -> None:
    """Train a head that predicts scale and shift from a caption's embedding.

    \b
      rsa-data train-head --head mlp5 --name nyu
    """
    result = call(train_head_function, WorkDir(work), bar=console.bar, **options)
    click.echo(result.summary)
    say_next(WorkDir(work), f"evaluate --head {options['name']}")


@click.command()
@work_option
@click_options(evaluate_function)
def evaluate(work: str, **options: Any) -> None:
    """Measure a head on the test splits.

    Oracles and constants are measured beside it.

    \b
      rsa-data evaluate --head nyu
    """
    result = call(evaluate_function, WorkDir(work), bar=console.bar, **options)
    click.echo(result.summary)
    say_next(WorkDir(work), use(WorkDir(work), options["head"]))


def _files(*, outputs: Outputs = Outputs()) -> Outputs:
    return outputs


@click.command()
@work_option
@click.argument("photos", nargs=-1, type=click.Path(path_type=Path), metavar="[PHOTO]...")
@click.option("--image", "images", multiple=True, type=click.Path(path_type=Path), hidden=True)
@click_options(predict_function)
@click_options(_files)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON list and nothing else.")
def predict(
    work: str, photos: tuple[Path, ...], images: tuple[Path, ...], as_json: bool, **options: Any
) -> None:
    """Predict metric depth of photos or captions.

    PHOTO is an image, a folder of images or a video. For each photo: scale and shift, the caption,
    nearest, median and farthest depth, and the objects with their share of the image and their
    distance. Without a head, known distances give the metres.

    \b
      rsa-data predict room.jpg --head rsa-depth-anything --out room.png --colours --ply
      rsa-data predict room.jpg --known 320,240,2.5 --known 80,400,1.2 --glb
      rsa-data predict --head nyu --caption "a small bathroom with a sink"
    """
    writer = Writer(call(_files, **{name: options.pop(name) for name in parameters(_files)}))
    places, said, failed = [*photos, *images], [], 0
    check(writer.outputs, several=len(places) > 1)
    for found in call(predict_function, WorkDir(work), places, **options):
        try:
            writer.write(found)
        except RsaDataError as error:
            if isinstance(error, UsageError):
                raise
            found.error = str(error)
        failed += bool(found.error)
        if as_json:
            said.append(found.plain())
        else:
            for line in found.lines:
                click.echo(line, err=bool(found.error))
        found.depth = found.image = None
    if as_json:
        click.echo(json.dumps(said, indent=2, ensure_ascii=False))
    if failed:
        several = "" if failed == 1 else "s"
        raise RsaDataError(f"{failed:,} photo{several} could not be processed")


@click.command("export-head")
@work_option
@click.argument("name")
@click.argument("place", type=click.Path(path_type=Path))
def export_head(work: str, name: str, place: Path) -> None:
    """Write a head to take to another machine, with its model card.

    PLACE is a file NAME.safetensors, which holds everything, or a folder as the Hugging Face hub
    takes it.

    \b
      rsa-data export-head nyu nyu.safetensors
    """
    for path in export_function(WorkDir(work), name, place):
        click.echo(f"wrote {path}")
    at = shlex.quote(str(place))
    command = use(WorkDir(work), name).replace(f"--head {name} ", f"--head {at} ")
    if command.startswith("predict"):
        click.echo(f"next: rsa-data {command}")


@click.command("import-head")
@work_option
@click.argument("file", type=click.Path(path_type=Path))
@click_options(import_function)
def import_head(work: str, file: Path, **options: Any) -> None:
    """Turn a released RSA checkpoint (.pt) into a head of the work dir.

    \b
      rsa-data import-head da_lanscale.pt --name released
    """
    where, description = call(import_function, WorkDir(work), file, **options)
    click.echo(f"head {where}: {description['architecture']['name']}")
    for name, measures in description["imported"]["measures"].items():
        numbers = "  ".join(f"{key} {value:.4f}" for key, value in measures.items())
        click.echo(f"  its own test measures, {name}: {numbers}")
    say_next(WorkDir(work), use(WorkDir(work), Path(where).name))
