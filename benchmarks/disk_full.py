"""Fills a small tmpfs with the captions stage, makes room, and goes on. Needs root, for mount.

    python benchmarks/disk_full.py

First the disk check stops a run that will not fit; then, with the disk filled up by somebody else
in the middle of a run, the write itself fails. Each time the error must be ours, what was committed
must verify, and after space is made the same command must end with the bytes of a run that always
had room.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

import rooms

from rsa_data.runner import runs, verify
from rsa_data.store.tables import WorkDir

PARTS, ROWS = 40, 500


def mount(place: Path, *options: str) -> None:
    subprocess.run(["mount", *options, "tmpfs", str(place)], check=True)


def main() -> int:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    bad = 0
    with tempfile.TemporaryDirectory(prefix="rsa-data-full-") as name:
        base = Path(name)
        roomy = rooms.made(base / "roomy", PARTS, ROWS)
        runs.run(rooms.captions_job(roomy), bar=rooms.NoBar)
        expected = receipts(roomy)
        need = sum(r.bytes for r in expected) // 1000
        print(f"captions of {PARTS} parts: {need} kB")
        for what in ("will not fit", "filled in the middle"):
            place = base / what.replace(" ", "-")
            place.mkdir()
            mount(place, "-t", "tmpfs", "-o", "size=64m")
            try:
                work = rooms.made(place / "work", PARTS, ROWS)
                bad += fill_and_free(what, place, work, expected)
            finally:
                subprocess.run(["umount", str(place)], check=True)
    print(f"{bad} problems")
    return 1 if bad else 0


def fill_and_free(what: str, place: Path, work: WorkDir, expected: list) -> int:
    need = sum(r.bytes for r in expected)
    ballast = place / "ballast"
    if what == "will not fit":
        ballast.write_bytes(bytes(work.store.free() - need // 2))
    words = [sys.executable, "-m", "rsa_data", "captions", "--dataset", "rooms"]
    words += ["--segments", "labels", "--work", str(place / "work")]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    table = work.table("rooms", "captions/occupancy")
    if what == "filled in the middle":
        while process.poll() is None and len(table.parts()) < 3:
            pass
        with ballast.open("wb", buffering=0) as file:
            try:
                while file.write(bytes(65536)):
                    pass
            except OSError:
                pass
    output, _ = process.communicate()
    done = table.parts()
    said: list[str] = []
    verify.verify(work, said.append)
    valid = all("parts are missing" in line for line in said[:-1])
    print(f"{what}: status {process.returncode}, {len(done)} parts committed, valid: {valid}")
    print("  " + output.strip().splitlines()[-1][:300])
    ballast.unlink()
    again = subprocess.run(words, capture_output=True, text=True, check=False)
    same = receipts(work) == expected
    print(f"  with space again: status {again.returncode}, the same receipts and bytes: {same}")
    clear = process.returncode == 1 and "Error: " in output and "Traceback" not in output
    return sum((not clear, not valid, again.returncode != 0, not same, len(done) == PARTS))


def receipts(work: WorkDir) -> list:
    table = work.table("rooms", "captions/occupancy")
    return [table.receipt(n) for n in table.parts()]


if __name__ == "__main__":
    sys.exit(main())
