"""What a training came to, for the person who asked for it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow.compute as pc

from ...datasets import labels
from ...depth.notes import wrong_way
from ...store.tables import WorkDir
from ..belong import Source
from ..description import Description, Used


@dataclass(frozen=True)
class Trained:
    """What a training came to.

    path : folder of the head. about : its head.json.
    directions : sentences on y that runs the wrong way; see `directions`.
    """

    path: str
    about: Description
    directions: tuple[str, ...] = ()

    @property
    def description(self) -> dict[str, object]:
        """head.json as plain values."""
        return self.about.plain()

    @property
    def summary(self) -> str:
        """A few lines for the person who asked for it."""
        about = self.about
        best = about.validation.epoch if about.validation else 0
        lines = [
            f"head {self.path}: {about.name}, {about.parameters or 0:,} parameters, best of "
            f"{about.epochs_run or 0} epochs: {best}"
        ]
        for name, used in about.trained_on.items():
            error = about.validation.abs_rel.get(name) if about.validation else None
            told = "" if error is None else f": AbsRel {error:.4f}"
            lines.append(
                f"  {labels.shown(name, used.synthetic)}: {used.images:,} images trained on, "
                f"{used.validation_images:,} for validation ({used.validation}){told}"
            )
        return "\n".join([*lines, *self.warnings])

    @property
    def warnings(self) -> list[str]:
        """What a person should know before they trust the head."""
        found = [f"warning: {text}" for text in self.directions]
        found += [
            f"warning: {name}: {_images(used.validation_images)} to validate and only "
            f"{used.images:,} to train on: whole scenes are held out, and one of them is large. "
            "Index more scenes, or images with smaller scenes"
            for name, used in self.about.trained_on.items()
            if _lopsided(used)
        ]
        if (
            self.about.validation
            and self.about.validation.epoch == 1
            and self.about.epochs_run != 1
        ):
            found.append(
                "warning: the first epoch was the best: training further made the validation "
                "images worse, so the head hardly knows more than typical values. More images, or "
                "a smaller --lr or --head linear, may help"
            )
        return found


def _images(count: int) -> str:
    return f"{count:,} image{'s' * (count != 1)}"


def _lopsided(used: Used) -> bool:
    return used.validation_images > used.images


def directions(
    work: WorkDir, sources: list[Source], parts: Mapping[str, list[int]], depth_model: str
) -> tuple[str, ...]:
    """A sentence for each dataset where y grows with the distance in most images.

    parts : of each dataset, those that were trained on.
    """
    found = []
    for source in sources:
        table = work.table(source.dataset, source.depth)
        scales = [table.read(n, ["fit_scale"])["fit_scale"] for n in parts[source.dataset]]
        values = [pc.drop_null(column).to_numpy() for column in scales]
        negative = np.concatenate(values) < 0
        if len(negative) and negative.mean() > 0.5:
            found.append(
                f"{source.dataset}: {wrong_way(float(negative.mean()), depth_model)}; "
                "--start-over makes the table again"
            )
    return tuple(found)
