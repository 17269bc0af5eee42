"""Commands that make tables: detect, captions, embed, depth, run, retry-failed."""

from pathlib import Path
from typing import Any

import click

from ..captions.write import build as captions_build
from ..common.options import click_options
from ..depth.measure import build as depth_build
from ..embeddings.embed import build as embed_build
from ..embeddings.embed_images import build as embed_images_build
from ..embeddings.proposals import build as proposals_build
from ..runner import chains, pipeline_files, stages
from ..runner.chains import How
from ..segments.detect import build as detect_build
from ..store.tables import WorkDir
from ..views.pictures.pictures import save
from ..views.pictures.preview import preview as draw_preview
from .shared import key_values, one_dataset, running, say_next


@click.command()
@running
@one_dataset
@click.option("--preview", metavar="N", type=int, help="Draw N images with what was found.")
@click_options(detect_build, hidden=stages.GIVEN)
def detect(
    work: WorkDir,
    how: How,
    dataset: str,
    root: Path | None,
    given: dict,
    preview: int | None,
    **options: Any,
) -> None:
    """Find what each image shows: a model's boxes or panoptic segments, or an import.

    \b
      rsa-data detect --dataset nyuv2 --source yolox-nano --model yolox_nano.onnx --preview 12
    """
    chains.check_names(source=options["source"], own=options["model_card"] is not None)
    name = chains.samples(work, dataset, given, root=root, source=options["source"])
    chains.stage(work, "detect", name, options, how, root=root)
    if preview and how.plan is None:
        segments = stages.name_of(options["source"])
        sheet = Path(f"preview-{name}-{segments}.png")
        save(draw_preview(work, name, f"segments/{segments}", preview, root), sheet)
        click.echo(f"preview: {sheet}")
    say_next(work, f"captions --dataset {name}")


@click.command()
@running
@one_dataset
@click.option("--segments", metavar="SOURCE", help="A segmenter, or an import as NAME:PLACE.")
@click_options(captions_build, hidden=stages.GIVEN)
def captions(
    work: WorkDir,
    how: How,
    dataset: str,
    root: Path | None,
    given: dict,
    segments: str | None,
    **options: Any,
) -> None:
    """Write the captions of a dataset, its index and segments first where they are missing.

    \b
      rsa-data captions --dataset nyuv2
      rsa-data captions --dataset nyuv2 --segments rsa-release:RSA/text
    """
    chains.check_names(source=segments, style=options["style"])
    name = chains.samples(work, dataset, given, root=root, source=segments or "")
    chains.captions(work, name, options, how, segments=segments, detect={}, root=root)
    say_next(work, f"embed --dataset {name}")


@click.command()
@running
@click.option("--dataset", "wanted", multiple=True, help="Only this dataset; may be repeated.")
@click.option("--style", help="Which captions, when there are several.")
@click_options(embed_build)
def embed(
    work: WorkDir, how: How, wanted: tuple[str, ...], style: str | None, **options: Any
) -> None:
    """Turn the captions of every dataset into text embeddings, each distinct text once.

    \b
      rsa-data embed --encoder minilm
      rsa-data embed --encoder clip-rn50 --weights RN50.pt
    """
    for name in chains.known_datasets(work, wanted):
        chains.embed(work, name, options, how, style=style)
    say_next(work, "depth --dataset NAME --depth-model MODEL, then: rsa-data train-head")


@click.command("embed-proposals")
@running
@click.option("--dataset", "wanted", multiple=True, help="Only this dataset; may be repeated.")
@click.option("--source", help="Which segments, when there are several.")
@click_options(proposals_build)
def embed_proposals(
    work: WorkDir, how: How, wanted: tuple[str, ...], source: str | None, **options: Any
) -> None:
    """Lay the detector's features of each image's objects side by side, for the head `proposals`.

    \b
      rsa-data detect --dataset nyuv2 --features OUTPUT
      rsa-data embed-proposals
    """
    for name in chains.known_datasets(work, wanted):
        chains.proposals(work, name, options, how, source=source)
    say_next(work, "train-head --style proposals --head proposals")


@click.command("embed-images")
@running
@one_dataset
@click_options(embed_images_build, hidden=stages.GIVEN)
def embed_images(
    work: WorkDir, how: How, dataset: str, root: Path | None, given: dict, **options: Any
) -> None:
    """Turn the images of a dataset into features, for a head that learns from images.

    \b
      rsa-data embed-images --dataset nyuv2 --encoder clip-rn50
      rsa-data embed-images --dataset nyuv2 --encoder hf:openai/clip-vit-large-patch14-336
    """
    name = chains.samples(work, dataset, given, root=root)
    chains.stage(work, "embed-images", name, options, how, root=root)
    say_next(work, "train-head --style images")


@click.command()
@running
@one_dataset
@click_options(depth_build, hidden=stages.GIVEN)
def depth(
    work: WorkDir, how: How, dataset: str, root: Path | None, given: dict, **options: Any
) -> None:
    """Relative depth of a model, or from files, beside the ground truth.

    \b
      rsa-data depth --dataset nyuv2 --depth-model depth-anything-v2-small
    """
    name = chains.samples(work, dataset, given, root=root)
    chains.stage(work, "depth", name, options, how, root=root)
    say_next(work, "train-head")


@click.command()
@click.argument("job")
@running
@click.option("--root", "roots", multiple=True, callback=key_values, metavar="DATASET=DIR")
@click.option("--set", "changes", multiple=True, callback=key_values, metavar="STAGE.OPTION=VALUE")
def run(work: WorkDir, how: How, job: str, roots: dict, changes: dict) -> None:
    """Run a job file: a whole chain with its options.

    \b
      rsa-data run 7scenes --root 7scenes=DIR
    """
    changes = {**{f"dataset.{name}.root": place for name, place in roots.items()}, **changes}
    loaded = pipeline_files.load(Path(job), changes)
    click.echo(loaded.get("doc", ""))
    pipeline_files.run(work, loaded, how, lambda step, result: click.echo(result.summary))


@click.command("retry-failed")
@running
@click.option("--dataset", "wanted", multiple=True, help="Only this dataset; may be repeated.")
def retry_failed(work: WorkDir, how: How, wanted: tuple[str, ...]) -> None:
    """Do the parts with failed rows again, after the input has been mended.

    \b
      rsa-data retry-failed
    """
    chains.retry_failed(work, chains.known_datasets(work, wanted), how)
