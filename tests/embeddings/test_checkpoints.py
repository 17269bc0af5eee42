"""Checkpoints in every form that CLIP is published in, and files that are something else."""

import pickle
import zipfile
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from rsa_data.common.errors import RsaDataError
from rsa_data.embeddings.checkpoints import read_tensors
from rsa_data.embeddings.clip import read_text_tower
from rsa_data.embeddings.clip_text import TextTower

TINY = {"width": 64, "heads": 1, "layers": 1, "context": 8, "vocabulary": 30, "dim": 16}


class Bomb:
    """Unpickled by an ordinary unpickler it would make a file."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def state() -> dict[str, torch.Tensor]:
    """The tensors of a tiny text tower."""
    torch.manual_seed(0)
    tower = TextTower(**TINY)
    return {name: torch.randn_like(value) for name, value in tower.state_dict().items()}


def scripted(tensors: dict[str, torch.Tensor]) -> torch.jit.ScriptModule:
    """A TorchScript module that holds tensors by their dotted names."""

    class Holder(nn.Module):
        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return x

    root = Holder()
    for name, tensor in tensors.items():
        *path, last = name.split(".")
        holder = root
        for step in path:
            if not hasattr(holder, step):
                holder.add_module(step, Holder())
            holder = getattr(holder, step)
        holder.register_parameter(last, nn.Parameter(tensor))
    return torch.jit.script(root)


def write_safetensors(path: Path) -> None:
    save_file(state(), path)


def write_state_dict(path: Path) -> None:
    torch.save(state(), path)


def write_legacy_state_dict(path: Path) -> None:
    torch.save(state(), path, _use_new_zipfile_serialization=False)


def write_open_clip_training(path: Path) -> None:
    wrapped = {"module." + name: value for name, value in state().items()}
    torch.save({"epoch": 3, "state_dict": wrapped}, path)


def write_torchscript(path: Path) -> None:
    torch.jit.save(scripted(state()), path)


WRITERS = [
    write_safetensors,
    write_state_dict,
    write_legacy_state_dict,
    write_open_clip_training,
    write_torchscript,
]
each_form = pytest.mark.parametrize("write", WRITERS, ids=lambda write: write.__name__[6:])
# Making a TorchScript file is deprecated; OpenAI's files are there all the same.
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit:DeprecationWarning")


@each_form
def test_every_form_gives_the_same_tower(write, tmp_path):
    write(tmp_path / "weights")
    tower = read_text_tower(tmp_path / "weights", **TINY)
    found = tower.state_dict()
    assert found.keys() == state().keys()
    assert all(torch.equal(found[name], value) for name, value in state().items())


def test_half_precision_torchscript_becomes_float32(tmp_path):
    halves = {name: value.half() for name, value in state().items()}
    others = {
        "visual.conv1.weight": torch.ones(2),
        "transformer.resblocks.0.attn_mask": torch.ones(8, 8),
        "logit_scale": torch.tensor(4.6),
        "input_resolution": torch.tensor(224.0),
    }
    torch.jit.save(scripted({**halves, **others}), tmp_path / "RN50.pt")
    found = read_text_tower(tmp_path / "RN50.pt", **TINY).state_dict()
    assert all(torch.equal(found[name], value.float()) for name, value in halves.items())


@each_form
@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.99])
def test_truncated_files_are_refused(write, share, tmp_path):
    write(tmp_path / "weights")
    data = (tmp_path / "weights").read_bytes()
    (tmp_path / "weights").write_bytes(data[: int(len(data) * share)])
    with pytest.raises(RsaDataError, match="weights: expected a"):
        read_text_tower(tmp_path / "weights", **TINY)


@each_form
def test_another_architecture_is_refused(write, tmp_path):
    write(tmp_path / "weights")
    with pytest.raises(RsaDataError, match="another architecture"):
        read_text_tower(tmp_path / "weights", **{**TINY, "layers": 2})
    with pytest.raises(RsaDataError, match=r"another architecture: found .*resblocks\.0"):
        read_text_tower(tmp_path / "weights", **{**TINY, "layers": 0})
    with pytest.raises(RsaDataError, match=r"has shape \(30, 64\); expected \(31, 64\)"):
        read_text_tower(tmp_path / "weights", **{**TINY, "vocabulary": 31})


def test_weights_that_are_not_finite_are_refused(tmp_path):
    tensors = state()
    tensors["ln_final.bias"][3] = torch.nan
    save_file(tensors, tmp_path / "weights")
    with pytest.raises(RsaDataError, match=r"damaged: ln_final\.bias"):
        read_text_tower(tmp_path / "weights", **TINY)


def test_a_pickle_that_runs_code_is_refused_and_does_not_run(tmp_path):
    made = tmp_path / "made"
    torch.save({"token_embedding.weight": Bomb(made)}, tmp_path / "zip.pt")
    (tmp_path / "plain.pt").write_bytes(pickle.dumps(Bomb(made), protocol=2))
    for name in ("zip.pt", "plain.pt"):
        with pytest.raises(RsaDataError, match="would run code"):
            read_tensors(tmp_path / name)
    assert not made.exists()


def test_a_torchscript_archive_that_runs_code_is_refused_and_does_not_run(tmp_path):
    made = tmp_path / "made"
    with zipfile.ZipFile(tmp_path / "RN50.pt", "w") as archive:
        archive.writestr("RN50/constants.pkl", pickle.dumps(()))
        archive.writestr("RN50/data.pkl", pickle.dumps(Bomb(made), protocol=2))
    with pytest.raises(RsaDataError, match="would run code: refused"):
        read_tensors(tmp_path / "RN50.pt")
    assert not made.exists()


def test_missing_and_foreign_files_say_what_is_expected(tmp_path):
    with pytest.raises(RsaDataError, match="it cannot be read: No such file"):
        read_tensors(tmp_path / "none.pt")
    (tmp_path / "page.pt").write_text("<html>Not found</html>")
    with pytest.raises(RsaDataError, match="expected a"):
        read_tensors(tmp_path / "page.pt")
    save_file({"visual.conv1.weight": torch.ones(1)}, tmp_path / "image.safetensors")
    with pytest.raises(RsaDataError, match="expected CLIP's text tower"):
        read_text_tower(tmp_path / "image.safetensors", **TINY)
