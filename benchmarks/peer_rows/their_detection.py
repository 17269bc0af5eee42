"""YOLOX nano as its model page shows: read, letterbox, run, decode, suppress, one image at a time.

way loop suppresses with OpenCV, way supervision with Detections.with_nms.
"""

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import onnxruntime

given = json.loads(sys.argv[1])
cv2.setNumThreads(given["threads"])
settings = onnxruntime.SessionOptions()
settings.intra_op_num_threads = given["threads"]
session = onnxruntime.InferenceSession(given["model"], settings, providers=["CPUExecutionProvider"])
name, SIDE = session.get_inputs()[0].name, 416
cells, strides = [], []
for stride in (8, 16, 32):
    x, y = np.meshgrid(np.arange(SIDE // stride), np.arange(SIDE // stride))
    cells.append(np.stack((x, y), 2).reshape(-1, 2))
    strides.append(np.full((cells[-1].shape[0], 1), stride))
cells, strides = np.concatenate(cells), np.concatenate(strides)


def prepare(image):
    ratio = min(SIDE / image.shape[0], SIDE / image.shape[1])
    size = int(image.shape[1] * ratio), int(image.shape[0] * ratio)
    padded = np.full((SIDE, SIDE, 3), 114, np.uint8)
    padded[: size[1], : size[0]] = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(padded.transpose(2, 0, 1), np.float32)[None], ratio


def decode(output, ratio, image):
    rows = output[0]
    centre = (rows[:, :2] + cells) * strides
    half = np.exp(rows[:, 2:4]) * strides / 2
    scores = rows[:, 4:5] * rows[:, 5:]
    number, score = scores.argmax(1), scores.max(1)
    kept = score > 0.3
    box = np.concatenate([centre - half, centre + half], 1)[kept] / ratio
    box, score, number = suppress(box, score[kept], number[kept])
    limit = [image.shape[1], image.shape[0]] * 2
    return np.column_stack([number, np.clip(box, 0, limit)])


def with_opencv(box, score, number):
    sides = np.concatenate([box[:, :2], box[:, 2:] - box[:, :2]], 1)
    if not len(box):
        return box, score, number
    kept = cv2.dnn.NMSBoxesBatched(sides.tolist(), score.tolist(), number.tolist(), 0.3, 0.45)
    return box[kept], score[kept], number[kept]


def with_supervision(box, score, number):
    import supervision as sv

    found = sv.Detections(xyxy=box, confidence=score, class_id=number).with_nms(threshold=0.45)
    return found.xyxy, found.confidence, found.class_id


suppress = with_supervision if given["way"] == "supervision" else with_opencv
begun = time.process_time()
found = []
for path in given["images"]:
    image = cv2.imread(path)
    tensor, ratio = prepare(image)
    found.append(sorted(decode(session.run(None, {name: tensor})[0], ratio, image).tolist()))
steady = time.process_time() - begun
Path(given["out"]).write_text(json.dumps(found))
print(json.dumps({"steady": steady}))
