"""The command predict. On its own, since it must answer soon: it imports no training."""

import json
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from ..common.errors import RsaDataError, UsageError
from ..common.options import call, parameters
from ..heads.predict.find import is_path
from ..heads.predict.photos import is_video, listed
from ..heads.predict.predict import predict as predict_function
from ..store.outputs import identities
from ..store.tables import WorkDir
from ..views.depth_files.write import Outputs, Writer
from .options import FilePath, click_options
from .shared import work_option


def _files(*, outputs: Outputs = Outputs()) -> Outputs:
    return outputs


@click.command()
@work_option
@click.argument("photos", nargs=-1, type=FilePath(), metavar="[PHOTO]...")
@click.option("--image", "images", multiple=True, type=FilePath(), hidden=True)
@click_options(predict_function)
@click_options(_files)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON list and nothing else.")
def predict(
    work: str, photos: tuple[Path, ...], images: tuple[Path, ...], as_json: bool, **options: Any
) -> None:
    """Predict metric depth of photos or captions.

    PHOTO is an image, a folder of images or a video. For each photo: scale and shift, the caption,
    nearest, median and farthest depth (0.5th, 50th and 99.5th percentile), and the objects with
    their share of the image and their distance. Without a head, known distances give the metres.

    \b
      rsa-data predict room.jpg --head rsa-depth-anything --out room.png --colours --ply
      rsa-data predict room.jpg --known 320,240,2.5 --known 80,400,1.2 --glb
      rsa-data predict --head nyu --caption "a small bathroom with a sink"
    """
    outputs = call(_files, **{name: options.pop(name) for name in parameters(_files)})
    source = click.get_current_context().get_parameter_source("kind")
    if source is ParameterSource.COMMANDLINE and (outputs.out is None or outputs.is_file):
        raise UsageError(
            "--kind: it is the format of the files in the folder --out, and no folder is given: "
            "name one, or leave --kind out"
        )
    places, said, failed = [*photos, *images], [], 0
    found = listed(places)
    given = [value for value in options.values() if isinstance(value, Path)]
    given += [Path(options["head"])] if options["head"] and is_path(options["head"]) else []
    read = [*given, *(photo.path for photo in found), *(p for p in places if p.is_file())]
    writer = Writer(outputs, identities(read) if outputs else ())
    names = [photo.name for photo in found]
    # Of a video, the first two frames stand for all of them.
    names += [f"{p.name}/{number:06d}.png" for p in places if is_video(p) for number in (1, 2)]
    if not places and options["relative"]:
        names = [options["relative"].name]
    writer.check(names)
    for result in call(predict_function, WorkDir(work), places, **options):
        try:
            writer.write(result)
        except RsaDataError as error:
            if isinstance(error, UsageError):
                raise
            result.error = str(error)
        failed += bool(result.error)
        if as_json:
            said.append(result.plain())
        else:
            for line in result.lines:
                click.echo(line, err=bool(result.error))
        result.depth = result.image = None
    if as_json:
        click.echo(json.dumps(said, indent=2, ensure_ascii=False))
    if failed:
        several = "" if failed == 1 else "s"
        raise RsaDataError(f"{failed:,} photo{several} could not be processed")
