"""What files from strangers cannot do; SECURITY.md says the rest."""

import io
import os
import pickle

import numpy as np
import pytest

from rsa_data import ScaleHead
from rsa_data.common import onnx_sessions
from rsa_data.common.errors import RowError, RsaDataError
from rsa_data.datasets.depth_files import npy
from rsa_data.datasets.images import read_bytes
from rsa_data.datasets.listing import inside
from rsa_data.depth import files


@pytest.fixture
def onnx_model(tmp_path):
    """Writes an ONNX model whose only weight lies in the file `location`, or in the model."""
    onnx = pytest.importorskip("onnx")

    def write(location: str | None, nested: bool = False):
        weight = onnx.TensorProto(name="w", data_type=1, dims=[4])
        if location is None:
            weight.raw_data = np.zeros(4, np.float32).tobytes()
        else:
            weight.data_location = onnx.TensorProto.EXTERNAL
            weight.external_data.add(key="location", value=location)
        value = onnx.helper.make_tensor_value_info
        put = [onnx.helper.make_node("Add", ["x", "w"], ["y"])], [weight]
        if nested:
            put = [onnx.helper.make_node("Constant", [], ["w"], value=weight), *put[0]], []
        graph = onnx.helper.make_graph(
            put[0], "g", [value("x", 1, [4])], [value("y", 1, [4])], put[1]
        )
        model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 13)])
        model.ir_version = 8
        path = tmp_path / "m.onnx"
        path.write_bytes(model.SerializeToString())
        return path

    return write


@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize("location", ["../secret.bin", "/etc/passwd", "beside.bin"])
def test_an_onnx_model_cannot_read_other_files(onnx_model, location, nested):
    with pytest.raises(RsaDataError, match="expected an ONNX model in one file"):
        onnx_sessions.open_session(onnx_model(location, nested))


@pytest.mark.parametrize("nested", [False, True])
def test_an_onnx_model_in_one_file_opens(onnx_model, nested):
    session = onnx_sessions.open_session(onnx_model(None, nested))
    assert session.run(None, {"x": np.ones(4, np.float32)})[0].tolist() == [1, 1, 1, 1]


@pytest.mark.parametrize("name", ["tu2020_mbv2_blconv7dw_nyu_224", "yolox_nano"])
def test_real_models_open(shared, name):
    assert onnx_sessions.open_session(shared / f"models/{name}.onnx").get_inputs()


@pytest.mark.parametrize("data", [b"", b"\xff" * 100, b"PK\3\4 not a model"])
def test_what_is_no_onnx_model_is_an_error_of_ours(tmp_path, data):
    (tmp_path / "m.onnx").write_bytes(data)
    with pytest.raises(RsaDataError, match="expected an ONNX model that onnxruntime can run"):
        onnx_sessions.open_session(tmp_path / "m.onnx")


class Bomb:
    """Would leave a trace if it were unpickled."""

    def __init__(self, trace):
        self.trace = trace

    def __reduce__(self):
        return os.mkdir, (str(self.trace),)


def test_no_array_is_unpickled(tmp_path):
    buffer = io.BytesIO()
    np.save(buffer, np.array([Bomb(tmp_path / "trace")], dtype=object), allow_pickle=True)
    (tmp_path / "a.npy").write_bytes(buffer.getvalue())
    for read in (npy(1.0), lambda path: files.read(path.parent, "a")):
        with pytest.raises(RowError):
            read(tmp_path / "a.npy")
    assert not (tmp_path / "trace").exists()


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
def test_no_checkpoint_runs_code(tmp_path):
    from rsa_data.embeddings import checkpoints

    torch = pytest.importorskip("torch")
    torch.save({"a": Bomb(tmp_path / "trace")}, tmp_path / "a.pt")
    (tmp_path / "b.pt").write_bytes(pickle.dumps(Bomb(tmp_path / "trace")))
    for path in (tmp_path / "a.pt", tmp_path / "b.pt"):
        for read in (checkpoints.read_tensors, ScaleHead.load):
            with pytest.raises(RsaDataError):
                read(path)
    assert not (tmp_path / "trace").exists()


@pytest.mark.parametrize("text", ["../a", "a/../../b", "/../a", "a\0b", "", "//a/../b"])
def test_paths_of_split_files_stay_below_the_root(text):
    with pytest.raises(RsaDataError, match="expected a path below the dataset's root"):
        inside(text, "list.txt line 1")


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.jpg")
    with pytest.raises(RowError, match="found a pipe, socket or device"):
        read_bytes(tmp_path / "a.jpg")
