"""Optional packages: which pip extra brings the one that an import misses."""

from typing import Any

from .errors import RsaDataError

# Which pip extra brings the package that an import error names.
_EXTRAS = {
    "h5py": "mat",
    "scipy": "mat",
    "pycocotools": "masks",
    "ray": "ray",
    "onnxscript": "export",
    "onnx": "export",
    "boto3": "s3",
    "obstore": "cloud",
    "nicegui": "play",
}


class extras:
    """Turns the import error of an optional package into the pip line that installs it."""

    def __init__(self, what: str):
        self.what = what

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, ModuleNotFoundError) and error.name in _EXTRAS:
            extra = _EXTRAS[error.name]
            raise RsaDataError(
                f"{self.what} needs the package {error.name!r}, which is not installed: "
                f'pip install "rsa-data[{extra}]"'
            ) from error
