"""Every name a user can extend or choose: tables of literal NAME -> "module:attribute".

An addition is one file and one line here. Targets are strings so that an optional package loads
only when it is used. For names that installed packages add see common/entries.py.
"""

from .common.entries import Entries
from .common.lookup import build as build
from .common.lookup import check as check
from .common.lookup import described as described
from .common.lookup import resolve as resolve

DATASETS = Entries(
    "datasets",
    {
        "nyuv2": "rsa_data.datasets.nyuv2:nyuv2",
        "kitti": "rsa_data.datasets.kitti:kitti",
        "void": "rsa_data.datasets.void:void",
        "7scenes": "rsa_data.datasets.seven_scenes:seven_scenes",
        "folder": "rsa_data.datasets.folder:folder",
        "sunrgbd": "rsa_data.datasets.sunrgbd:sunrgbd",
        "sun3d": "rsa_data.datasets.sun3d:sun3d",
        "ddad": "rsa_data.datasets.ddad:ddad",
        "webdataset": "rsa_data.datasets.webdataset:webdataset",
        "parquet": "rsa_data.datasets.parquet:parquet",
        "zip": "rsa_data.datasets.webdataset:zipped",
        "nyuv2-parquet": "rsa_data.datasets.hub_copies:nyuv2_parquet",
        "nyuv2-fastdepth": "rsa_data.datasets.hub_copies:nyuv2_fastdepth",
        "moge": "rsa_data.datasets.moge:moge",
        "nyuv2-labeled": "rsa_data.datasets.nyuv2_labeled:nyuv2_labeled",
        "synthetic-indoor": "rsa_data.datasets.synthetic.dataset:synthetic_indoor",
        "synthetic-street": "rsa_data.datasets.synthetic.dataset:synthetic_street",
    },
)

# Networks that a model card describes, and graphs that tell by themselves what they are.
_BY_CARD = (
    "detr-resnet-50-panoptic", "deeplab-edgetpu-cityscapes", "deeplab-v3-voc", "detr-resnet-50",
    "dfine-small", "fastestdet", "maskdino", "maskformer", "nanodet-m", "rtdetr-r18vd", "onnx",
    "rtdetr-r50vd", "road-segmentation-adas-0001", "yolox-nano", "yolox-s", "yolox-tiny",
)  # fmt: skip

SEGMENTERS = Entries(
    "segmenters",
    {
        **dict.fromkeys(_BY_CARD, "rsa_data.segments.onnx:build"),
        "rsa-release": "rsa_data.segments.rsa_release:build",
        "coco-panoptic": "rsa_data.segments.coco_panoptic:build",
        "coco-detections": "rsa_data.segments.coco_detections:build",
        "cityscapes": "rsa_data.segments.cityscapes:build",
        "labels": "rsa_data.segments.label_maps:build",
    },
)

DECODERS = Entries(
    "decoders",
    {
        "yolox": "rsa_data.segments.boxes:yolox",
        "fastestdet": "rsa_data.segments.boxes:fastestdet",
        "nanodet": "rsa_data.segments.boxes:nanodet",
        "detr": "rsa_data.segments.queries:detr",
        "panoptic-queries": "rsa_data.segments.queries:panoptic",
        "yolo": "rsa_data.segments.yolo:yolo",
        "final-rows": "rsa_data.segments.final_rows:final_rows",
        "final-boxes": "rsa_data.segments.final_rows:final_boxes",
        "nms-rows": "rsa_data.segments.inside_nms:rows",
        "instances": "rsa_data.segments.inside_nms:instances",
        "semantic": "rsa_data.segments.semantic:semantic",
    },
)

STYLES = Entries(
    "styles",
    {
        "classes": "rsa_data.captions.wordings.classes:classes",
        "counts": "rsa_data.captions.wordings.counts:counts",
        "occupancy": "rsa_data.captions.wordings.occupancy:occupancy",
        "occupied": "rsa_data.captions.wordings.occupied:occupied",
        "occupied-share": "rsa_data.captions.wordings.occupied:occupied_share",
        "located": "rsa_data.captions.wordings.located:located",
        "grid": "rsa_data.captions.wordings.grid:grid",
        "intrinsics": "rsa_data.captions.wordings.intrinsics:intrinsics",
        "release": "rsa_data.captions.wordings.release:release",
        "release-text": "rsa_data.captions.natural:release_text",
        "import": "rsa_data.captions.imports:import_texts",
        "member": "rsa_data.captions.members:member",
        "vlm": "rsa_data.captions.vlm:vlm",
    },
    ("rsa_data.captions.wordings.wording:Wording", "collections.abc:Callable"),
)

TOKENIZERS = Entries(
    "tokenizers", {name: f"rsa_data.common.tokenizers:{name}" for name in ("clip", "minilm", "hf")}
)

ENCODERS = Entries(
    "encoders",
    {
        "minilm": "rsa_data.embeddings.sentence:MINILM",
        "clip-rn50": "rsa_data.embeddings.clip:CLIP_RN50",
        "hf": "rsa_data.embeddings.huggingface:HF",
    },
    ("rsa_data.embeddings.encoder:Encoder",),
)

IMAGE_ENCODERS = Entries(
    "image_encoders",
    {
        "clip-rn50": "rsa_data.embeddings.clip:CLIP_RN50_IMAGE",
        "hf": "rsa_data.embeddings.huggingface_image:HF_IMAGE",
        "thumbnail": "rsa_data.embeddings.thumbnail:THUMBNAIL",
    },
    ("rsa_data.embeddings.encoder:Encoder",),
)

_DEPTH_BY_CARD = (
    "tu2020", "depth-anything-v2-small", "depth-anything-small", "dpt-hybrid-midas",
    "dpt-hybrid-finetuned", "midas-swin2-large-384", "midas-v21-small",
)  # fmt: skip

DEPTH_MODELS = Entries(
    "depth_models",
    {
        "files": "rsa_data.depth.files:build",
        **dict.fromkeys(_DEPTH_BY_CARD, "rsa_data.depth.onnx:build"),
    },
)

HEADS = Entries(
    "heads",
    {
        "mlp5": "rsa_data.heads.architectures.mlp5:Mlp5",
        "mlp3": "rsa_data.heads.architectures.mlp3:Mlp3",
        "transformer": "rsa_data.heads.architectures.transformer:Transformer",
        "linear": "rsa_data.heads.architectures.linear:Linear",
        "fusion": "rsa_data.heads.architectures.fusion:Fusion",
        "proposals": "rsa_data.heads.architectures.proposals:Proposals",
        "objects": "rsa_data.heads.architectures.objects:Objects",
        "objects-without-places": "rsa_data.heads.architectures.objects:ObjectsWithoutPlaces",
        "object-names": "rsa_data.heads.architectures.objects:ObjectNames",
        "text-objects": "rsa_data.heads.architectures.objects:TextAndObjects",
        "image-objects": "rsa_data.heads.architectures.objects:ImageAndObjects",
        "text-image-objects": "rsa_data.heads.architectures.objects:TextImageAndObjects",
    },
    ("rsa_data.heads.architectures.layers:Head",),
)

# Row stages, in the order data flows; see runner/stage.py.
STAGES = Entries(
    "stages",
    {
        "detect": "rsa_data.segments.detect:STAGE",
        "captions": "rsa_data.captions.write:STAGE",
        "embed": "rsa_data.embeddings.embed:STAGE",
        "embed-images": "rsa_data.embeddings.embed_images:STAGE",
        "embed-objects": "rsa_data.embeddings.objects:STAGE",
        "embed-proposals": "rsa_data.embeddings.proposals:STAGE",
        "depth": "rsa_data.depth.measure:STAGE",
    },
)

# Steps of a pipeline file that work on whole tables, after the row stages.
STEPS = {
    "train-head": "rsa_data.heads.train.train_head:train_head",
    "evaluate": "rsa_data.evaluation.evaluate:evaluate",
    "compare": "rsa_data.evaluation.compare:compare",
    "robustness": "rsa_data.evaluation.robustness:robustness",
}

# Worker pools; see runner/engines/pool.py.
_ENGINES = {
    "local": "rsa_data.runner.engines.local:Processes",
    "ray": "rsa_data.runner.engines.ray:Actors",
}
ENGINES = Entries("engines", _ENGINES)

# Where work dirs and roots may lie, by the scheme of the address; folders need none.
STORES = Entries(
    "stores",
    {
        **dict.fromkeys(("s3", "gs", "az"), "rsa_data.store.objects:ObjectStore"),
        "hf": "rsa_data.store.hub:HubFiles",
        **dict.fromkeys(("https", "http"), "rsa_data.store.http:HttpFiles"),
    },
)

# What a work dir holds beside datasets: FOLDER -> how to list and check it.
COLLECTIONS = {
    "heads": "rsa_data.heads.collection:HEADS",
    "comparisons": "rsa_data.evaluation.output:COMPARISONS",
}

# What a head can read of an image; a head's class names the kinds that it reads.
INPUTS = Entries(
    "inputs",
    {
        "text": "rsa_data.heads.inputs.text:TEXT",
        "image": "rsa_data.heads.inputs.image:IMAGE",
        "proposals": "rsa_data.heads.inputs.proposals:PROPOSALS",
        "objects": "rsa_data.heads.inputs.objects:OBJECTS",
    },
    ("rsa_data.heads.inputs.kinds:Kind",),
)

LOSSES = Entries(
    "losses",
    {
        "l1": "rsa_data.heads.train.losses:L1",
        "huber": "rsa_data.heads.train.losses:HUBER",
        "log-l1": "rsa_data.heads.train.losses:LOG_L1",
        "silog": "rsa_data.heads.train.losses:SILOG",
    },
    ("rsa_data.heads.train.losses:Loss",),
)

# In the order that tables print them.
METRICS = Entries(
    "metrics",
    {
        "delta1": "rsa_data.evaluation.metrics:DELTA1",
        "delta2": "rsa_data.evaluation.metrics:DELTA2",
        "delta3": "rsa_data.evaluation.metrics:DELTA3",
        "abs_rel": "rsa_data.evaluation.metrics:ABS_REL",
        "sq_rel": "rsa_data.evaluation.metrics:SQ_REL",
        "rmse": "rsa_data.evaluation.metrics:RMSE",
        "rmse_log": "rsa_data.evaluation.metrics:RMSE_LOG",
        "log10": "rsa_data.evaluation.metrics:LOG10",
        "silog": "rsa_data.evaluation.metrics:SILOG",
    },
    ("rsa_data.evaluation.metrics:Metric",),
)

PROTOCOLS = Entries(
    "protocols",
    {
        "rsa": "rsa_data.evaluation.protocols:RSA",
        "bts": "rsa_data.evaluation.protocols:BTS",
        "monodepth2": "rsa_data.evaluation.protocols:MONODEPTH2",
        "depth-anything": "rsa_data.evaluation.protocols:DEPTH_ANYTHING",
    },
    ("rsa_data.evaluation.protocols:Protocol",),
)

# What other rooms reach through the registry, as they may not import it.
UPWARDS = {
    "scale-head": "rsa_data.heads.checkpoint:ScaleHead",
    "evaluations": "rsa_data.evaluation.output:problems_below",
}
