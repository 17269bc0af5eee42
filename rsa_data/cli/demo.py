"""The command that shows the whole chain, on scenes that it renders itself."""

import time
from dataclasses import replace
from pathlib import Path

import click

from ..runner import pipeline_files
from ..runner.chains import RunOptions
from ..store.tables import WorkDir
from . import console
from .following import use
from .shared import report

# Pictures of a sheet: a few of each dataset, spread over its test scenes.
_SHOWN = 4


@click.command()
@click.option("--work", default="work/demo", show_default=True, help="Work dir to write to.")
def demo(work: str) -> None:
    """Run the whole chain on synthetic scenes.

    \b
      rsa-data demo

    No download is needed; it takes under a minute on two cores. Renders scenes, imports their
    segments, writes captions, embeds them with a sentence encoder whose weights came with the
    package, trains a head and a control whose captions are shuffled,
    measures both on held-out scenes, and draws a sheet of predictions.
    """
    begun = time.monotonic()
    place = WorkDir(work)
    pipeline = pipeline_files.load(Path("demo"))
    for name, entry in pipeline.datasets.items():
        pipeline.datasets[name] = replace(entry, root=str(Path(work) / "scenes" / name))
    pipeline_files.run(
        place,
        pipeline,
        RunOptions(console.bar, report),
        lambda step, result: click.echo(result.summary),
    )
    sheet = Path(work) / "predictions.png"
    draw(place, list(pipeline.datasets), sheet)
    click.echo(f"scenes with caption, true depth, prediction and error: {sheet}")
    click.echo(f"all of it in {console.duration(time.monotonic() - begun)}; nothing here was real")
    click.echo(f"next: rsa-data {use(place, 'demo')} --work {work}")
    click.echo("for your own images: rsa-data list datasets folder")


def draw(work: WorkDir, datasets: list[str], path: Path) -> None:
    """Writes a contact sheet of test scenes as the head `demo` sees them."""
    from ..datasets.images import read_image
    from ..datasets.index import load_dataset
    from ..evaluation.depth_errors import depth_errors
    from ..views.pictures import pictures
    from ..views.report.samples import choose

    rows = []
    for name in datasets:
        dataset = load_dataset(work, name)
        shown = [s for s in choose(work, name, 4 * _SHOWN, "demo") if s.predicted is not None]
        # Scenes of one kind may stand at equal distances: a stride of 3 meets several kinds.
        for s in shown[::3][:_SHOWN]:
            assert s.where is not None and s.truth is not None and s.predicted is not None
            assert s.scale is not None and s.shift is not None
            rows.append(
                pictures.Prediction(
                    name=s.row["sample_id"],
                    image=read_image(s.where / s.row["image"]),
                    caption=s.captions[0].partition(": ")[2],
                    truth=s.truth,
                    predicted=s.predicted,
                    scale=s.scale,
                    shift=s.shift,
                    abs_rel=depth_errors(
                        s.truth,
                        s.predicted,
                        min_depth=dataset.min_depth,
                        max_depth=dataset.max_depth,
                    )["abs_rel"],
                )
            )
    sheet = pictures.contact_sheet(
        rows,
        title="Metric depth from a caption, on synthetic scenes",
        note="Held-out scenes. The scale and the shift come from the caption alone; the relative "
        "depth they are applied to is rendered, with noise.",
    )
    pictures.save(sheet, path)
