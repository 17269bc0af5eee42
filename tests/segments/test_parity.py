"""Parity with transformers: tiny models of random weights, exported here, post-processed by both.

Its processors say what a model of that family means; ours must find the same in the same image.
"""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from rsa_data.common.cards import Card
from rsa_data.common.class_names import ClassTable
from rsa_data.segments import graph

pytestmark = pytest.mark.slow

LABELS = 5
TABLE = ClassTable({n: f"c{n}" for n in range(LABELS)}, frozenset({0, 1, 2}), LABELS)
# Sides that all the processors below turn into 96 x 128.
HEIGHT, WIDTH = 180, 240


def picture(seed=0):
    """Smooth noise: uint8 RGB of shape (HEIGHT, WIDTH, 3)."""
    import cv2

    coarse = np.random.default_rng(seed).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    return cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)


def backbone():
    from transformers import ResNetConfig

    return ResNetConfig(
        embedding_size=8,
        hidden_sizes=[8, 16, 24, 32],
        depths=[1, 1, 1, 1],
        layer_type="basic",
        out_features=["stage1", "stage2", "stage3", "stage4"],
    )


def small(prefixes=("encoder", "decoder"), **more):
    layers = {f"{p}_{k}": v for p in prefixes for k, v in (("layers", 1), ("ffn_dim", 32))}
    return layers | {f"{p}_attention_heads": 8 for p in prefixes} | {"num_queries": 12} | more


def detr():
    from transformers import DetrConfig, DetrForSegmentation

    config = DetrConfig(
        use_timm_backbone=False,
        backbone_config=backbone(),
        **small(d_model=128, num_labels=LABELS),
    )
    return DetrForSegmentation(config), ("logits", "pred_boxes", "pred_masks")


def rt_detr():
    from transformers import RTDetrConfig, RTDetrForObjectDetection, RTDetrResNetConfig

    config = RTDetrConfig(
        backbone_config=RTDetrResNetConfig(
            embedding_size=8,
            hidden_sizes=[8, 16, 24, 32],
            depths=[1, 1, 1, 1],
            layer_type="basic",
            out_features=["stage2", "stage3", "stage4"],
        ),
        encoder_in_channels=[16, 24, 32],
        decoder_in_channels=[32, 32, 32],
        encoder_hidden_dim=32,
        num_denoising=0,
        anchor_image_size=None,
        **small(d_model=32, num_labels=LABELS),
    )
    return RTDetrForObjectDetection(config), ("logits", "pred_boxes")


def maskformer():
    from transformers import DetrConfig, MaskFormerConfig, MaskFormerForInstanceSegmentation

    decoder = DetrConfig(use_timm_backbone=False, backbone_config=backbone(), **small(d_model=32))
    config = MaskFormerConfig(
        fpn_feature_size=32,
        mask_feature_size=32,
        backbone_config=backbone(),
        decoder_config=decoder,
        num_labels=LABELS,
    )
    return MaskFormerForInstanceSegmentation(config), QUERIES


def mask2former():
    from transformers import Mask2FormerConfig, Mask2FormerForUniversalSegmentation

    config = Mask2FormerConfig(
        backbone_config=backbone(),
        feature_size=32,
        mask_feature_size=32,
        hidden_dim=32,
        encoder_feedforward_dim=32,
        encoder_layers=1,
        decoder_layers=2,
        num_attention_heads=2,
        dim_feedforward=32,
        num_queries=12,
        num_labels=LABELS,
    )
    return Mask2FormerForUniversalSegmentation(config), QUERIES


QUERIES = ("class_queries_logits", "masks_queries_logits")


def spread(values):
    """Random weights answer every query nearly alike; this makes their logits differ by 4 or so."""
    if values.shape[-1] == 4:
        return values  # boxes
    values = values - values.mean(1, keepdim=True)
    return 4 * values / values.std()


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """name -> (path of the ONNX file, names of its outputs), each exported once."""
    import torch

    done = {}

    def export(name):
        if name in done:
            return done[name]
        torch.manual_seed(1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model, outputs = MODELS[name]()
            model.eval()

            class Plain(torch.nn.Module):
                def __init__(self):
                    super().__init__()
                    self.model = model

                def forward(self, pixel_values):
                    found = self.model(pixel_values=pixel_values)
                    return tuple(spread(found[key]) for key in outputs)

            path = tmp_path_factory.mktemp(name) / f"{name}.onnx"
            program = torch.onnx.export(
                Plain(),
                (torch.zeros(1, 3, 96, 128),),
                dynamo=True,
                verbose=False,
                input_names=["pixel_values"],
                output_names=list(outputs),
            )
            program.save(path)
        done[name] = path, outputs
        return done[name]

    return export


MODELS = {"detr": detr, "rt_detr": rt_detr, "maskformer": maskformer, "mask2former": mask2former}

IMAGENET = {"mean": [0.485, 0.456, 0.406], "std": [0.229, 0.224, 0.225]}
SHORTEST = {"resize": "shortest", "shortest": 96, "longest": 1333, **IMAGENET}


def card(outputs, decoder, resize):
    common = {"name": "pixel_values", "resample": "pillow", "scale": 1 / 255}
    settings = {
        "input": {**common, **resize},
        "output": outputs,
        "decoder": decoder,
        "classes": {},
    }
    return Card(name="tiny", settings=settings)


def both(exported, name, processor, outputs, decoder, resize):
    """(our segments with masks, the graph's outputs as transformers' processors take them).

    The two input tensors differ in their last bit, which these models blow up to 1e-3 in the
    score; so they are compared here, and both decode the outputs of ours.
    """
    import onnxruntime
    import torch

    path, names = exported(name)
    image = picture()
    detector = graph.load(card(outputs, decoder, resize), path, table=TABLE, with_masks=True)
    tensor, geometry = detector.prepare(image)
    found = detector.finish(detector.run([(tensor, geometry)])[0], geometry)
    theirs = processor(images=image, return_tensors="np")["pixel_values"]
    np.testing.assert_allclose(tensor, theirs, atol=2e-6)
    session = onnxruntime.InferenceSession(str(path))
    arrays = session.run(list(names), {"pixel_values": tensor})
    return found, SimpleNamespace(**dict(zip(names, map(torch.from_numpy, arrays), strict=True)))


def decode_mask(counts):
    from pycocotools import mask as coco_mask

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return coco_mask.decode({"size": [HEIGHT, WIDTH], "counts": counts}).astype(bool)


def assert_same_segments(found, theirs):
    index, infos = theirs["segmentation"].numpy(), theirs["segments_info"]
    assert len(infos) >= 3, "the case is too easy"
    assert list(found.label) == [f"c{info['label_id']}" for info in infos]
    np.testing.assert_allclose(found.score, [info["score"] for info in infos], atol=1e-4)
    for mask, area, info in zip(found.mask, found.area, infos, strict=True):
        np.testing.assert_array_equal(decode_mask(mask), index == info["id"])
        assert area == np.count_nonzero(index == info["id"]) / (HEIGHT * WIDTH)


PANOPTIC = {
    "family": "panoptic-queries",
    "score": "softmax",
    "score_threshold": 0.3,
    "overlap_threshold": 0.2,
}
THRESHOLDS = {
    "threshold": 0.3,
    "overlap_mask_area_threshold": 0.2,
    "label_ids_to_fuse": set(),
    "target_sizes": [(HEIGHT, WIDTH)],
}


def test_detr_panoptic(exported):
    from transformers.models.detr.image_processing_pil_detr import DetrImageProcessorPil

    processor = DetrImageProcessorPil(size={"shortest_edge": 96, "longest_edge": 1333})
    outputs = {"classes": "logits", "masks": "pred_masks"}
    found, raw = both(exported, "detr", processor, outputs, PANOPTIC, SHORTEST)
    theirs = processor.post_process_panoptic_segmentation(raw, **THRESHOLDS)
    assert_same_segments(found, theirs[0])


def test_maskformer(exported):
    from transformers.models.maskformer.image_processing_pil_maskformer import (
        MaskFormerImageProcessorPil,
    )

    processor = MaskFormerImageProcessorPil(size={"shortest_edge": 90, "longest_edge": 1333})
    outputs = dict(zip(("classes", "masks"), QUERIES, strict=True))
    resize = SHORTEST | {"shortest": 90, "multiple": 32}
    found, raw = both(exported, "maskformer", processor, outputs, PANOPTIC, resize)
    theirs = processor.post_process_panoptic_segmentation(raw, **THRESHOLDS)
    assert_same_segments(found, theirs[0])


def test_mask2former(exported):
    from transformers.models.mask2former.image_processing_pil_mask2former import (
        Mask2FormerImageProcessorPil,
    )

    processor = Mask2FormerImageProcessorPil(size={"shortest_edge": 96, "longest_edge": 1333})
    outputs = dict(zip(("classes", "masks"), QUERIES, strict=True))
    decoder = PANOPTIC | {"through": [384, 384], "sigmoid": "between"}
    resize = SHORTEST | {"multiple": 32}
    found, raw = both(exported, "mask2former", processor, outputs, decoder, resize)
    theirs = processor.post_process_panoptic_segmentation(raw, **THRESHOLDS)
    assert_same_segments(found, theirs[0])


def assert_same_boxes(found, theirs):
    theirs = {key: values.numpy() for key, values in theirs.items()}
    assert len(theirs["labels"]) >= 3, "the case is too easy"
    order = np.lexsort((theirs["labels"], -theirs["scores"]))
    ours = np.lexsort((found.label, -found.score))
    limits = [WIDTH, HEIGHT, WIDTH, HEIGHT]
    boxes = np.clip(theirs["boxes"][order], 0, limits)
    np.testing.assert_allclose(found.box[ours], boxes, atol=1e-2)
    np.testing.assert_allclose(found.score[ours], theirs["scores"][order], atol=1e-4)
    labels = [f"c{number}" for number in theirs["labels"][order]]
    assert [found.label[k] for k in ours] == labels


def test_detr_boxes(exported):
    from transformers.models.detr.image_processing_pil_detr import DetrImageProcessorPil

    processor = DetrImageProcessorPil(size={"shortest_edge": 96, "longest_edge": 1333})
    outputs = {"classes": "logits", "boxes": "pred_boxes"}
    decoder = {"family": "detr", "score": "softmax", "score_threshold": 0.3}
    found, raw = both(exported, "detr", processor, outputs, decoder, SHORTEST)
    theirs = processor.post_process_object_detection(
        raw, threshold=0.3, target_sizes=[(HEIGHT, WIDTH)]
    )
    assert_same_boxes(found, theirs[0])


def test_rt_detr_boxes(exported):
    from transformers.models.rt_detr.image_processing_pil_rt_detr import RTDetrImageProcessorPil

    processor = RTDetrImageProcessorPil(size={"height": 96, "width": 128})
    outputs = {"classes": "logits", "boxes": "pred_boxes"}
    decoder = {"family": "detr", "score": "sigmoid", "score_threshold": 0.3}
    resize = {"resize": "stretch", "size": [96, 128]}
    found, raw = both(exported, "rt_detr", processor, outputs, decoder, resize)
    theirs = processor.post_process_object_detection(
        raw, threshold=0.3, target_sizes=[(HEIGHT, WIDTH)]
    )
    assert_same_boxes(found, theirs[0])
