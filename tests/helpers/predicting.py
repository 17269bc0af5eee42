"""predict, called from Python and as a command."""

import json

from click.testing import CliRunner

from rsa_data.cli.main import cli
from rsa_data.common import options as binding
from rsa_data.common.errors import RsaDataError
from rsa_data.heads.predict.predict import predict as predict_function
from rsa_data.store.tables import WorkDir


def predict(work, *photos, **options):
    """The predictions of a call, its options flat as on the command line."""
    return list(binding.call(predict_function, work, photos, **options))


def run(work, *words):
    """The command, its words as text."""
    done = CliRunner().invoke(cli, ["predict", *map(str, words), "--work", work.store.location])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        assert isinstance(done.exception, RsaDataError), done.exception
    return done


def head_for_images(work: WorkDir) -> None:
    """The head of `work`, with the captions and the depth model of a real training."""
    path = work.store.folder / "heads/head/head.json"
    about = json.loads(path.read_text())
    del about["digest"]  # as of a head that was written before there were digests
    about["captions"] = {"rooms": {"style": "occupancy", "variants": 5, "tokenizer": "minilm"}}
    geometry = {"rooms": {"geometry": None, "crop": "none"}}
    about["depth_model"] = {"model": "tu2020", "options": {}, "files": {}, "geometry": geometry}
    path.write_text(json.dumps(about))


def real(shared) -> dict:
    """Options that name the real models."""
    return {
        "segments": "yolox-nano",
        "segmenter_weights": shared / "models" / "yolox_nano.onnx",
        "depth_weights": shared / "models" / "tu2020_mbv2_blconv7dw_nyu_224.onnx",
    }
