"""What all tests of shards share."""

import io

import numpy as np
import pytest
from PIL import Image
from shard_files import COLUMNS, frames, tables

from rsa_data.store.tables import WorkDir


@pytest.fixture(scope="session")
def expected(tmp_path_factory):
    """What a folder gives, and the folder with label maps and relative depth."""
    place = tmp_path_factory.mktemp("loose")
    for key, parts in frames().items():
        labels = io.BytesIO()
        Image.fromarray(np.full((40, 60), int(key[-1]), np.uint8)).save(labels, "PNG")
        relative = io.BytesIO()
        np.save(relative, np.linspace(0.1, 1, 2400).reshape(40, 60))
        for path, data in {
            f"photos/{key}.png": parts["png"],
            f"photos/depth/{key}.png": parts.get("depth.png"),
            f"labels/{key}.png": labels.getvalue(),
            f"relative/{key}.npy": relative.getvalue(),
        }.items():
            if data is not None:
                (place / path).parent.mkdir(parents=True, exist_ok=True)
                (place / path).write_bytes(data)
    work = WorkDir(place / "work")
    return tables(work, "folder:photos", COLUMNS, place / "photos", place)[0], place
