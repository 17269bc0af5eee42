"""COCO files of one image, a.jpg, and the samples row that names it."""

import rooms

PANOPTIC = {
    "images": [{"id": 1, "file_name": "a.jpg", "width": 4, "height": 3}],
    "annotations": [
        {
            "image_id": 1,
            "file_name": "a.png",
            "segments_info": [{"id": 7, "category_id": 1, "area": 12, "iscrowd": 0}],
        }
    ],
    "categories": [{"id": 1, "name": "bed", "isthing": 1}],
}
RESULTS = {
    "images": [{"id": 1, "file_name": "a.jpg", "width": 4, "height": 3}],
    "annotations": [
        {"image_id": 1, "category_id": 1, "score": 0.5, "bbox": [0, 0, 2, 2]},
        {"image_id": 1, "category_id": 1, "segmentation": {"size": [3, 4], "counts": [0, 12]}},
    ],
    "categories": [{"id": 1, "name": "bed"}],
}

SAMPLES = rooms.sample_rows(["rooms/train/a"])
SAMPLES = SAMPLES.set_column(
    SAMPLES.schema.get_field_index("image"), SAMPLES.schema.field("image"), [["a.jpg"]]
)
