"""predict, called from Python and as a command."""

from click.testing import CliRunner

from rsa_data.cli.main import cli
from rsa_data.common import options as binding
from rsa_data.common.errors import RsaDataError
from rsa_data.heads.predict.predict import predict as predict_function


def predict(work, *photos, **options):
    """The predictions of a call, its options flat as on the command line."""
    return list(binding.call(predict_function, work, photos, **options))


def run(work, *words):
    """The command, its words as text."""
    done = CliRunner().invoke(cli, ["predict", *map(str, words), "--work", work.store.location])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        assert isinstance(done.exception, RsaDataError), done.exception
    return done
