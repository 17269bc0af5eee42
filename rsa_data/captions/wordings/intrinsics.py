"""The style `intrinsics`: the camera before the objects."""

import pyarrow as pa

from ...common.errors import UsageError
from .occupancy import phrase
from .wording import Wording


def _camera(samples: pa.Table) -> list[str]:
    rows = samples.select(["sample_id", "fx", "fy", "cx", "cy"]).to_pylist()
    for row in rows:
        if None in row.values():
            raise UsageError(
                f"style 'intrinsics' tells of the camera, but {row['sample_id']} has no focal "
                "lengths and principal point in samples. Use the style occupancy, or a dataset "
                "with intrinsics"
            )
    return [
        "An image taken with focal lengths {fx:.0f} and {fy:.0f} pixels and principal point "
        "({cx:.0f},{cy:.0f}), with ".format(**row)
        for row in rows
    ]


intrinsics = Wording(
    1,
    "An image taken with focal lengths 519 and 519 pixels and principal point (326,254), with "
    "bed occupies 13.42% of the image, ...",
    phrase,
    opening=_camera,
)
