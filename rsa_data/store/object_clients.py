"""obstore's clients: one for each address, with the credentials that there are."""

import os
from datetime import timedelta
from pathlib import Path
from typing import Any

from ..common import bounded
from ..common.errors import RsaDataError

# Tries of one request, with back-off that doubles up to 20 s: about a minute and a half in all,
# longer than S3 takes to scale a prefix up.
TRIES = 10


def open_client(scheme: str, location: str, option: str) -> Any:
    """obstore's store, with the credentials that there are."""
    from obstore import exceptions, store

    from_url: Any = store.from_url

    given: dict[str, Any] = {}
    endpoint = next(filter(None, map(os.environ.get, _ENDPOINTS[scheme])), "")
    if scheme == "s3":
        given |= {"endpoint": endpoint} if endpoint else {}
        given |= _s3_credentials(location, option)
    elif option == "--root" and not _has_credentials(scheme):
        given["skip_signature"] = True
    backoff = {
        "init_backoff": timedelta(seconds=0.1),
        "max_backoff": timedelta(seconds=20),
        "base": 2,
    }
    try:
        return from_url(
            location,
            client_options={
                "connect_timeout": timedelta(seconds=10),
                # Of one request in all, answer included.
                "timeout": timedelta(seconds=bounded.limit("request")),
                "read_timeout": timedelta(seconds=60),
                "allow_http": endpoint.startswith("http://"),
            },
            retry_config={
                "backoff": backoff,
                "max_retries": TRIES - 1,
                "retry_timeout": timedelta(seconds=2 * bounded.limit("request")),
            },
            **given,
        )
    except (exceptions.BaseError, ValueError) as error:
        raise RsaDataError(f"{option} {location}: {str(error).splitlines()[0]}") from error


# Variables with the address of a server of the user's own, which may do without TLS.
_ENDPOINTS = {
    "s3": ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"),
    "gs": ("GOOGLE_BASE_URL",),
    "az": ("AZURE_STORAGE_ENDPOINT",),
}

_S3_VARIABLES = (
    "AWS_ACCESS_KEY_ID",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
)
_GS_VARIABLES = ("GOOGLE_APPLICATION_CREDENTIALS", "GOOGLE_SERVICE_ACCOUNT")
_GS_FILE = ".config/gcloud/application_default_credentials.json"


def _has_credentials(scheme: str) -> bool:
    if scheme == "az":
        return any(name.startswith("AZURE_") and name != _AZURE_NAME for name in os.environ)
    if any(name.startswith(_GS_VARIABLES) for name in os.environ):
        return True
    return (Path.home() / _GS_FILE).is_file()


_AZURE_NAME = "AZURE_STORAGE_ACCOUNT_NAME"


def _s3_credentials(location: str, option: str) -> dict[str, Any]:
    """What obstore is given beside what it reads from the environment by itself."""
    if any(os.environ.get(name) for name in _S3_VARIABLES):
        return {}
    try:
        import boto3
        from obstore.auth.boto3 import Boto3CredentialProvider
    except ImportError:
        return {"skip_signature": True} if option == "--root" else {}
    session = boto3.Session()
    if session.get_credentials() is not None:
        return {"credential_provider": Boto3CredentialProvider(session)}
    if option == "--root":
        return {"skip_signature": True}
    raise RsaDataError(
        f"cannot write {location}: expected credentials in the environment (AWS_ACCESS_KEY_ID "
        "...), in ~/.aws or of this machine's role; found none"
    )
