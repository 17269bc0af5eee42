"""Fixtures that more than one test file uses."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from weather import Weather, weather_before

# As the command line has it: threads that wait sleep, whoever else wants the cores.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


@pytest.fixture(autouse=True)
def nothing_typed() -> Iterator[None]:
    """What one test typed as code of its own, the next one did not."""
    yield
    os.environ.pop("RSA_DATA_TYPED_CODE", None)


@pytest.fixture(scope="session")
def shared() -> Path:
    """Real data and weights that stand beside a checkout on some machines; skips without them."""
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("real data (../shared/data) is not on this machine")
    return folder


@pytest.fixture(scope="module")
def weather() -> Iterator[Weather]:
    """A server of S3's protocol on loopback with a bucket, and the proxy before it."""
    boto3, moto_server = pytest.importorskip("boto3"), pytest.importorskip("moto.server")
    server = moto_server.ThreadedMotoServer(port=0, verbose=False)
    server.start()
    port = server.get_host_and_port()[1]
    with weather_before(port) as proxy, pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ACCESS_KEY_ID", "test")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "test")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        patch.setenv("AWS_ENDPOINT_URL_S3", f"http://127.0.0.1:{proxy.server_address[1]}")
        boto3.client("s3").create_bucket(Bucket="bucket")
        yield proxy
    server.stop()
