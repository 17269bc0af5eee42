"""What attacks begin with: a small whole work dir, real inputs, and servers that do harm."""

import contextlib
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

# Everything that commands import, so that a forked process begins with it.
_PRELOADED = (
    "rsa_data.cli.tables",
    "rsa_data.cli.heads",
    "rsa_data.cli.predict",
    "rsa_data.cli.look",
    "rsa_data.cli.report",
    "rsa_data.cli.export",
    "rsa_data.cli.studies",
    "rsa_data.cli.planning",
    "torch",
    "PIL.Image",
    "cv2",
    "onnxruntime",
    "urllib3",
    "transformers",
    "pyarrow.parquet",
)

_PIPELINE = """\
doc = "A few synthetic rooms through all stages."
[dataset.synthetic-indoor]
scenes = 12
test_scenes = 4
part_size = 10
test_part_size = 4
[detect]
segments = "coco-panoptic"
[captions]
variants = 2
[embed]
encoder = "minilm"
runtime = "torch"
[depth]
depth_model = "files"
[[train-head]]
name = "head"
head = "linear"
epochs = 2
[evaluate]
head = "head"
"""


class World:
    """place : an empty folder. base : a work dir that is whole, to copy. port : of the servers.

    Torch is never used in this process: its threads would not survive the forks.
    """

    def __init__(self, place: Path):
        self.place, self.base = place, place / "base"
        self.started: list[Callable[[], None]] = []  # what ends others' processes
        self.shared = Path(__file__).parents[3] / "shared" / "data"

    def __enter__(self) -> "World":
        from importlib import import_module

        self.base.mkdir()
        (self.base / "small.toml").write_text(_PIPELINE)
        self._run("run", "small.toml", "--root", "synthetic-indoor=scenes", "--work", "work")
        self._run("export-head", "head", "exported.safetensors", "--work", "work")
        self.seen = self.place / "seen.jsonl"
        self.seen.touch()
        self.servers = subprocess.Popen(
            [sys.executable, str(Path(__file__).parent / "servers.py"), str(self.seen)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.servers.stdout
        self.port, self.other = json.loads(self.servers.stdout.readline())
        for module in _PRELOADED:
            with contextlib.suppress(ImportError):
                import_module(module)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for stop in self.started:
            stop()
        self.servers.kill()
        self.servers.wait()

    def _run(self, *words: str) -> None:
        made = subprocess.run(
            [sys.executable, "-m", "rsa_data", *words],
            cwd=self.base,
            capture_output=True,
            text=True,
        )
        if made.returncode:
            raise SystemExit(f"rsa-data {' '.join(words)}\n{made.stdout}{made.stderr}")

    def copy(self, box: Path) -> Path:
        """A work dir of one's own, at box/work, with the scenes that it was made of."""
        shutil.copytree(self.base / "work", box / "work")
        (box / "scenes").symlink_to(self.base / "scenes")
        return box / "work"

    def told(self, name: str) -> list[dict[str, str]]:
        """The requests that the servers have seen for an attack."""
        lines = [json.loads(line) for line in self.seen.read_text().splitlines()]
        return [line for line in lines if name in line["path"]]
