"""The process of a command: signals, standard streams, errors that nobody expected."""

import os
import signal
import subprocess
import sys
import time

import pytest
import rooms

BUSY = {
    # In a library, without the interpreter: a model's graph that does not end looks like this.
    "library": "import hashlib; hashlib.pbkdf2_hmac('sha256', b'', b'', 2**31 - 1)",
    "thread": """
import socket, concurrent.futures
server = socket.create_server(("127.0.0.1", 0))
with concurrent.futures.ThreadPoolExecutor(4) as pool:
    list(pool.map(lambda _: server.accept(), range(4)))
""",
    "sleep": "import time; time.sleep(1000)",
    "swallows": """
import time
while True:
    try:
        time.sleep(1000)
    except BaseException:
        pass
""",
}


def command(body: str) -> list[str]:
    """A process that runs `body` as commands are run, after it has said so."""
    # A test run in the background of a shell ignores SIGINT, and its children would too.
    code = "import signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
    code += "from rsa_data.cli import process\ndef command():\n    print('begun', flush=True)\n"
    code += "".join(f"    {line}\n" for line in body.strip().split("\n"))
    return [sys.executable, "-c", code + "process.run(command)\n"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("body", BUSY)
def test_a_signal_ends_any_command_in_seconds(body, number):
    process = subprocess.Popen(command(BUSY[body]), stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stdout.readline() == b"begun\n"
    time.sleep(0.2)
    begun = time.monotonic()
    process.send_signal(number)
    try:
        _, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert time.monotonic() - begun < 5.5
    assert process.returncode == 130, err
    assert err.decode().strip() == (
        "Stopped. Finished parts are kept: run the same command to continue."
    )


@pytest.mark.parametrize("after", [0.1, 0.2, 0.4, 0.8])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_program_loads(tmp_path, number, after):
    words = [sys.executable, "-m", "rsa_data", "embed", "--work", str(tmp_path)]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(after)
    process.send_signal(number)
    _, err = process.communicate(timeout=30)
    # 1: it had ended before, with "no dataset there yet"; below 0: the interpreter was not up yet.
    assert process.returncode in (130, 1, -number)
    assert process.returncode < 0 or "Traceback" not in err


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        ("1 / 0", 1, "Error: unexpected ZeroDivisionError: division by zero. This is a fault of"),
        (
            "import os\nos.environ['RSA_DATA_CODE'] = 'mine:style'\n1 / 0",
            1,
            "Error: unexpected ZeroDivisionError: division by zero. This is a fault of rsa-data or "
            "the code mine:style: `rsa-data --debug",
        ),
        ("raise MemoryError", 1, "Error: out of memory"),
        ("raise OSError(28, 'No space left on device')", 1, "Error: No space left on device"),
        ("raise ValueError('a\\nb')", 1, "Error: unexpected ValueError: a b. This"),
        ("f = lambda: f()\nf()", 1, "Error: the input is nested too deeply"),
        ("print('\\u2713 \\udcff')", 0, ""),
    ],
)
def test_unexpected_errors_are_one_line(body, status, said):
    env = {**os.environ, "PYTHONIOENCODING": "ascii"}
    ended = subprocess.run(command(body), capture_output=True, text=True, check=False, env=env)
    assert ended.returncode == status, ended.stderr
    assert ended.stderr.startswith(said) and ended.stderr.count("\n") == (1 if said else 0)
    shown = subprocess.run(
        command(body),
        capture_output=True,
        text=True,
        check=False,
        env={**env, "RSA_DATA_DEBUG": "1"},
    )
    assert ("Traceback" in shown.stderr) == (status == 1)


@pytest.mark.parametrize(
    ("redirect", "status", "said"),
    [
        ("> /dev/full", 1, "Error: standard output cannot be written: "),
        (">&-", 1, "Error: standard output cannot be written: "),
        ("2>&-", 0, ""),
        ("<&- >&- 2>&-", 1, ""),
        ("| true", 0, ""),
    ],
)
def test_standard_streams_that_cannot_be_written(tmp_path, redirect, status, said):
    rooms.made(tmp_path, parts=1)
    words = f'"{sys.executable}" -m rsa_data status --work "{tmp_path}" {redirect}'
    ended = subprocess.run(words, shell=True, capture_output=True, text=True, check=False)
    assert ended.returncode == status, ended.stderr
    assert ended.stderr.startswith(said) and "Traceback" not in ended.stderr


@pytest.mark.parametrize("words", [["status"], ["--debug", "status"]])
def test_debug_shows_the_traceback(words):
    code = (
        "from rsa_data.cli import look, main\nlook.status.callback = lambda **_: 1 / 0\nmain.main()"
    )
    process = [sys.executable, "-c", code, *words]
    ended = subprocess.run(process, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert ("Traceback" in ended.stderr) == ("--debug" in words), ended.stderr
    assert "Error: unexpected ZeroDivisionError: division by zero" in ended.stderr
