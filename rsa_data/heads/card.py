"""The model card of a head, in Markdown: what it is, what it needs, how well it does."""

import re
from typing import Any

from ..common.cards import about as about_model
from ..store.tables import WorkDir
from .belong import kinds_of
from .description import Features


def model_card(name: str, about: dict[str, Any], work: WorkDir | None = None) -> str:
    """A card that Hugging Face shows too. about : head.json. work : where its evaluations are."""
    features, depth = Features.of(about["features"]), about.get("depth_model") or {}
    model = depth.get("model")
    lines = [
        "---",
        "library_name: rsa-data",
        "pipeline_tag: depth-estimation",
        "---",
        "",
        f"# {_text(name)}: a head for metric depth from relative depth",
        "",
        "metric depth = 1 / (scale * relative depth + shift): this head predicts the scale and the "
        "shift of an image from a description of it.",
        "",
        "    rsa-data predict photo.jpg --head FILE_OR_ADDRESS",
        "",
        "## What it reads",
        "",
        f"- Architecture: {_text(about['architecture']['name'])}, "
        f"{about.get('parameters') or 'an unknown number of'} parameters.",
        *(f"- {line}" for line in _inputs(features)),
        f"- Relative depth: {_text(model)}{_licence(model)}, at {_geometries(depth)}. Another "
        "model or geometry gives wrong metres.",
        f"- Segments in training: {_text(', '.join(sorted(_segments(about))) or None)}.",
        "",
        "## Data",
        "",
    ]
    datasets = about.get("datasets") or {}
    for dataset, used in datasets.items():
        rendered = "Synthetic: its images were rendered, not photographed. "
        lines.append(
            f"- {_text(dataset)}: {rendered if used.get('synthetic') else ''}"
            f"{used.get('images', 0):,} images to train on, "
            f"{used.get('validation_images', 0):,} to choose the epoch. The terms of the dataset "
            "apply to what is made from it."
        )
    if not datasets:
        lines.append("- Not stated.")
    lines += ["", "## Metrics", "", *(_evaluations(name, work) or ["Not measured."]), ""]
    lines += [
        "## Licences",
        "",
        "The licence of these weights is for their author to state. Those of the models that the "
        "head needs stand beside their names above.",
        "",
    ]
    return "\n".join(lines)


def _inputs(features: Features) -> list[str]:
    """Each input of the head in words, with the encoder and its licence."""
    found = []
    for kind, one in zip(kinds_of(features), (features, *(features.beside or [])), strict=True):
        # Of several inputs the first one's name holds those of all.
        encoder = (one.options or {}).get("encoder") or str(one.encoder or "").partition("+")[0]
        by = f"{_text(encoder)}{_licence(encoder)}"
        found.append(
            {
                "text": f"A caption in the style {_text(one.style)}, as features of {by}.",
                "objects": f"The photo's objects: their names as features of {by}, their shares of "
                "the image and their places.",
                "image": f"The photo itself, as features of {by}.",
            }.get(kind, f"Features of the kind {_text(kind)} by {by}.")
        )
    return found


def _text(value: Any) -> str:
    """Words from a description, without what Markdown or a terminal would take for its own."""
    return re.sub(r"[^\w .,+:/()=-]", "", str(value or "not stated"))[:200]


def _licence(name: Any) -> str:
    told = about_model(str(name)) if name and re.fullmatch(r"[\w.-]+", str(name)) else None
    return f" ({told})" if told else ""


def _segments(about: dict[str, Any]) -> set[str]:
    return {str(t).partition("/")[2] for t in (about.get("segments") or {}).values()}


def _geometries(depth: dict[str, Any]) -> str:
    ways = {str(g.get("geometry") or "the model's own size") for g in
            (depth.get("geometry") or {}).values()}  # fmt: skip
    return _text(", ".join(sorted(ways)) or "a size that is not stated")


def _evaluations(name: str, work: WorkDir | None) -> list[str]:
    """The summaries that `rsa-data evaluate` wrote for the head: protocols, means, intervals."""
    if work is None:
        return []
    lines: list[str] = []
    folder = f"heads/{name}/evaluation"
    for entry in work.store.list(folder):
        text = work.store.read(f"{folder}/{entry.rstrip('/')}/summary.md")
        if text is not None:
            # One level deeper, so that the card keeps its own headings.
            lines += [re.sub(r"^#", "###", line) for line in text.decode().splitlines()] + [""]
    return lines
