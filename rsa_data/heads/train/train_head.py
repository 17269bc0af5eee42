"""train-head: from the parts of any number of datasets to one head, checked before it begins."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from ... import registry
from ...common.errors import RsaDataError, UsageError, unknown
from ...datasets import index
from ...store.tables import WorkDir
from .. import belong
from .controls import Control


@dataclass(frozen=True)
class Trained:
    """What a training came to.

    path : folder of the head. description : its head.json.
    """

    path: str
    description: dict[str, Any]

    @property
    def summary(self) -> str:
        """A few lines for the person who asked for it."""
        validation = self.description["validation"]
        lines = [
            f"head {self.path}: {self.description['architecture']['name']}, "
            f"{self.description['parameters']:,} parameters, best of "
            f"{self.description['epochs_run']} epochs: {validation['epoch']}"
        ]
        for name, used in self.description["datasets"].items():
            lines.append(
                f"  {name}: {used['images']:,} images trained on, {used['validation_images']:,} "
                f"for validation ({used['validation']}): AbsRel {validation['abs_rel'][name]:.4f}"
            )
        return "\n".join(lines)


def train_head(
    work: WorkDir,
    bar: Callable[[str, int], Any] | None = None,
    *,
    datasets: tuple[str, ...] = (),
    style: str | None = None,
    encoder: str | None = None,
    depth_model: str | None = None,
    head: str = "mlp5",
    control: Control = "none",
    name: str = "head",
    loss: Literal["l1", "huber", "log-l1", "silog"] = "l1",
    supervision: Literal["depth", "fit", "both"] = "depth",
    units: Literal["relative", "metres"] = "relative",
    balance: Literal["datasets", "images"] = "datasets",
    log_loss: tuple[str, ...] = (),
    initial: Literal["typical", "random"] = "typical",
    optimizer: Literal["adam", "adamw"] = "adam",
    schedule: Literal["cosine", "polynomial"] = "cosine",
    lr: float = 1e-3,
    end_lr: float = 3e-5,
    warmup: float = 1.0,
    weight_decay: float = 0.0,
    clip: float = 1.0,
    epochs: int = 50,
    batch: int | None = None,
    pixels: int = 256,
    standardize: bool = True,
    validation: float = 0.1,
    split_scene: bool = False,
    patience: int = 0,
    precision: Literal["auto", "float32", "bfloat16"] = "auto",
    memory: float = 4.0,
    checkpoint_every: float = 20.0,
    threads: int = 2,
    seed: int = 0,
    start_over: bool = False,
) -> Trained:
    """Trains a head on the tables of a work dir and writes it to WORK/heads/NAME.

    A run that was killed goes on from its last finished epoch, to the same weights on the same
    machine; a head that is finished is left as it is.

    Parameters
    ----------
    datasets : datasets to train on, by default all in the work dir.
    style : caption style, needed when there are several.
    encoder : encoder, needed when there are several; TEXT+IMAGE puts the features of an image
        encoder behind those of the text.
    depth_model : relative-depth model, needed when there are several.
    head : architecture; see `rsa-data list heads`.
    control : train a control instead: each image with the captions of another image of its dataset
        (shuffled), or with no more than its dataset's name (dataset).
    name : folder of the head below WORK/heads.
    loss : what is minimised at the sampled pixels.
    supervision : learn from depth, from each image's own least-squares fit, or from both. Of a fit
        only what is positive counts, as a head's scale and shift are.
    units : relative divides the errors of l1 and huber by the dataset's mean depth, so that
        streets do not outweigh rooms; metres leaves them as they are.
    balance : datasets lets each dataset weigh the same, images each image.
    log_loss : datasets whose loss in a batch enters as its logarithm, so that its size does not
        matter. The released code does so, for NYUv2 and VOID but not for KITTI, by a slip.
    initial : begin with outputs at the datasets' typical scale and shift, or with random ones as
        the released code.
    optimizer : Adam, or AdamW.
    schedule : how the learning rate falls from lr to end-lr, cosine or polynomial (power 0.9).
    lr : learning rate at its highest.
    end_lr : learning rate at the end.
    warmup : epochs over which the learning rate rises from nothing.
    weight_decay : of the optimiser.
    clip : norm that gradients are clipped to; 0 for none.
    epochs : times that every image is seen, each time with a variant of its caption drawn anew.
    batch : images in a step; by default a sixteenth of all, but 16 to 256.
    pixels : pixels of each image in a step, of those that the depth table holds.
    standardize : centre the features and divide them by one number, their spread over the training
        set; part of the head. Without it the raw features go in, as in the released code.
    validation : share of the training images held out to choose the best epoch, whole scenes.
    split_scene : where a dataset has one scene only, hold out its last frames instead of refusing.
    patience : stop after so many epochs without a better validation error; 0 runs them all.
    precision : of the matrix products; auto takes bfloat16 where the processor has it in hardware,
        which is about twice as fast and ends at the same error.
    memory : GiB of examples held at once; larger tables are read in windows of parts every epoch.
    checkpoint_every : seconds of work that a kill may lose; at the end of an epoch the state is
        written when the last time is that long ago.
    threads : CPU threads; they can change the last bits of the weights.
    seed : of the first weights and of everything that is drawn.
    start_over : throw away the head of this name, finished or not, and train anew.
    """
    options = {k: v for k, v in locals().items() if k not in ("work", "bar", "start_over", "name")}
    options |= {"datasets": list(datasets), "log_loss": list(log_loss)}
    if precision == "auto":
        options["precision"] = _precision()
    if not 0 < validation <= 0.5:
        raise UsageError(f"--validation: expected more than 0, at most 0.5; found {validation}")
    registry.check("head", registry.HEADS, head)

    sources = belong.sources(work, datasets, style, encoder, depth_model)
    features = belong.same(
        "embeddings", {f"{s.dataset}/{s.embeddings}": belong.features_of(work, s) for s in sources}
    )
    depths = {s.dataset: belong.depth_identity(work.table(s.dataset, s.depth)) for s in sources}
    model = belong.same("depth", {f"{n}/depth": pair[0] for n, pair in depths.items()})
    geometry = {n: pair[1] for n, pair in depths.items()}

    limits, numbers, digests = {}, {}, {}
    for source in sources:
        dataset = index.load_dataset(work, source.dataset)
        limits[source.dataset] = (dataset.min_depth, dataset.max_depth)
        samples = work.table(source.dataset, "samples")
        chosen = [n for n in samples.parts() if samples.receipt(n).split not in dataset.test_splits]
        if not chosen:
            raise RsaDataError(
                f"{source.dataset}: expected training images; found only the test splits "
                f"{', '.join(dataset.test_splits)}, which no training may read"
            )
        numbers[source.dataset] = chosen
        parts = [belong.current(work, source, n) for n in chosen]
        digests[source.dataset] = belong.together(parts)

    for dataset_name in log_loss:
        if dataset_name not in numbers:
            raise unknown("dataset in --log-loss", dataset_name, numbers)
    first = sources[0]
    made_of = [first.embeddings, *([first.images] if first.images else [])]
    part = numbers[first.dataset][0]
    widths = [belong.width(work.table(first.dataset, table), part) for table in made_of]
    architecture: dict[str, Any] = {"name": head}
    if head == "fusion":
        if len(widths) != 2 or control == "dataset":
            raise UsageError(
                "--head fusion: expected features of text and of images: --encoder TEXT+IMAGE"
            )
        architecture["text_dim"] = widths[0]
    if head == "proposals":
        if not first.embeddings.startswith("embeddings/proposals/"):
            raise UsageError("--head proposals: expected --style proposals, by embed-proposals")
        architecture["feature_dim"] = widths[0] // features["options"]["most"] - 1
        options["standardize"] = False
    if control == "dataset":
        widths = [len(sources)]

    from .training_run import Plan, run

    plan = Plan(
        name,
        sources,
        numbers,
        limits,
        features,
        widths,
        architecture,
        model,
        geometry,
        digests,
        options,
    )
    return run(work, plan, bar, start_over)


def _precision() -> str:
    """bfloat16 where the processor has instructions for it, else float32."""
    import torch

    # Not public yet, so a later torch without them means float32.
    has = (getattr(torch.cpu, f"_is_{n}_supported", None) for n in ("avx512_bf16", "amx_tile"))
    return "bfloat16" if any(ask() for ask in has if ask) else "float32"
