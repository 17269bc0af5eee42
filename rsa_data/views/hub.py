"""Upload of an exported folder to the Hugging Face hub."""

from pathlib import Path

from ..common.errors import RsaDataError, TransientError


def push(folder: Path, name: str) -> None:
    """Uploads a folder as the dataset `OWNER/NAME`, which is created if it is not there.

    The token and the address of the hub are those of huggingface_hub (`hf auth login`, HF_TOKEN,
    HF_ENDPOINT). Raises RsaDataError, which says what the hub answered; the folder stays.
    """
    from huggingface_hub import HfApi
    from huggingface_hub.errors import HfHubHTTPError

    api = HfApi()
    try:
        api.create_repo(name, repo_type="dataset", exist_ok=True)
        api.upload_folder(
            repo_id=name,
            folder_path=folder,
            repo_type="dataset",
            commit_message="Captions, features and depth by rsa-data",
        )
    except HfHubHTTPError as error:
        raise RsaDataError(
            f"--push {name}: the hub answers: {error}. {folder} is whole; log in with "
            "`hf auth login`, or upload the folder yourself"
        ) from error
    except Exception as error:
        # The HTTP library, whose errors come through, depends on huggingface_hub's version.
        library = type(error).__module__.partition(".")[0]
        if not isinstance(error, OSError) and library not in ("httpx", "httpx2", "httpcore"):
            raise
        raise TransientError(
            f"--push {name}: the hub cannot be reached: {error}. {folder} is whole"
        ) from error
