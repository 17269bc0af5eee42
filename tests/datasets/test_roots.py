"""Dataset roots in a bucket and on a web server: what is read there is what a folder gives."""

import functools
import http.server
import pickle
import re
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest
import rooms
from ddad_scene import write_scene
from PIL import Image
from weather import weather_before

from rsa_data.common.errors import RowError, RsaDataError, TransientError, UsageError
from rsa_data.datasets import images, index
from rsa_data.datasets.ddad import ddad
from rsa_data.datasets.folder import folder
from rsa_data.datasets.kitti import kitti
from rsa_data.datasets.nyuv2 import nyuv2
from rsa_data.datasets.roots import open_root, readers
from rsa_data.datasets.seven_scenes import seven_scenes
from rsa_data.datasets.sun3d import sun3d
from rsa_data.datasets.sunrgbd import sunrgbd
from rsa_data.datasets.void import void
from rsa_data.runner import chains, jobs, runs, stages
from rsa_data.runner.engines.pool import EngineOptions
from rsa_data.store.objects import ObjectStore
from rsa_data.store.tables import WorkDir

THUMBNAILS = stages.bind("embed-images", {"encoder": "thumbnail"})
MATRIX = "5e2 0 3.2e2\n0 5.1e2 2.4e2\n0 0 1\n"


class Pages(http.server.SimpleHTTPRequestHandler):
    """A web server that lists its folders, but one, and keeps one to itself."""

    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        if self.path.startswith("/site/kept") or self.path == "/site/silent/":
            self.send_error(403)
        else:
            super().do_GET()

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder that is served, and the proxy before its server."""
    place = tmp_path_factory.mktemp("site")
    (place / "site").mkdir()
    handler = functools.partial(Pages, directory=str(place))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with weather_before(server.server_address[1]) as proxy:
            yield place / "site", proxy
        server.shutdown()


@pytest.fixture
def far(request, site):
    """Puts a folder where `request.param` says and returns the root there and the proxy."""

    def put(local: Path):
        name = request.node.name.translate(str.maketrans("[]", "__"))
        if request.param == "http":
            shutil.copytree(local, site[0] / name)
            site[1].troubles = []
            return open_root(f"http://127.0.0.1:{site[1].server_address[1]}/site/{name}"), site[1]
        weather = request.getfixturevalue("weather")
        client = pytest.importorskip("boto3").client("s3")
        weather.troubles = []
        for path in sorted(p for p in local.rglob("*") if p.is_file()):
            key = f"{name}/{path.relative_to(local).as_posix()}"
            client.put_object(Bucket="bucket", Key=key, Body=path.read_bytes())
        return open_root(f"s3://bucket/{name}/"), weather

    return put


everywhere = pytest.mark.parametrize("far", ["s3", "http"], indirect=True)


def write(root: Path, path: str, text: str = "x") -> None:
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_text(text)


def lay_out(root: Path) -> dict[Path, object]:
    """A small root for each dataset that is read from files."""
    drive = "2011_09_26_drive_0002_sync"
    frame = f"2011_09_26/{drive}/image_02/data/0000000069.png"
    truth = f"{drive}/proj_depth/groundtruth/image_02/0000000069.png"
    for path, text in {
        "nyuv2/sync/bedroom_0001a/rgb_00001.jpg": "x",
        "nyuv2/sync/bedroom_0001a/sync_depth_00001.png": "x",
        "nyuv2/official_splits/test/bathroom/rgb_00045.jpg": "x",
        "nyuv2/official_splits/test/bathroom/sync_depth_00045.png": "x",
        f"kitti/raw/{frame}": "x",
        "kitti/raw/2011_09_26/calib_cam_to_cam.txt": "P_rect_02: 7e2 0 6e2 44 0 7e2 1e2 0 0 0 1 0",
        f"kitti/data_depth_annotated/val/{truth}": "x",
        "kitti/data_splits/eigen_test_files_with_gt.txt": f"{frame} {truth} 721.5\n",
        "void/void_1500/test_image.txt": "void_1500/data/room4/image/1.png\n",
        "void/void_1500/test_ground_truth.txt": "void_1500/data/room4/ground_truth/1.png\n",
        "void/void_1500/train_image.txt": "void_1500/data/hall/image/2.png\n",
        "void/void_1500/train_ground_truth.txt": "void_1500/data/hall/ground_truth/2.png\n",
        "void/void_1500/data/room4/K.txt": MATRIX,
        "7scenes/chess/seq-01/frame-000000.color.png": "x",
        "7scenes/chess/seq-01/frame-000000.depth.png": "x",
        "7scenes/chess/seq-02/frame-000000.color.png": "x",
        "7scenes/chess/camera-intrinsics.txt": MATRIX,
        "7scenes/chess/TrainSplit.txt": "sequence1\n",
        "7scenes/chess/TestSplit.txt": "sequence2\n",
        "sun3d/hotel/room/image/0000001-000000000000.jpg": "x",
        "sun3d/hotel/room/depth/0000001-000000000900.png": "x",
        "sun3d/hotel/room/intrinsics.txt": MATRIX,
        "sunrgbd/SUNRGBD/kv2/a/0001/image/1.jpg": "x",
        "sunrgbd/SUNRGBD/kv2/a/0001/depth/1.png": "x",
        "sunrgbd/SUNRGBD_val_splits.txt": "SUNRGBD/kv2/a/0001/image/1.jpg "
        "SUNRGBD/kv2/a/0001/depth/1.png\n",
        "folder/train/a b/rgb/1 #50%.jpg": "x",
        "folder/train/a b/rgb/.hidden.jpg": "x",
        "folder/train/a b/depth/1 #50%.png": "x",
        "folder/test/ärger?/rgb/2&3;4.png": "x",
    }.items():
        write(root, path, text)
    write_scene(root / "ddad" / "000", [[0, 0, 3, 9]])
    return {
        root / "nyuv2": nyuv2(),
        root / "kitti": kitti(),
        root / "void": void(),
        root / "7scenes": seven_scenes(),
        root / "sun3d": sun3d(),
        root / "sunrgbd": sunrgbd(),
        root / "ddad": ddad(cameras="CAM"),
        root / "folder": folder(images="rgb", depth="depth", depth_unit="mm"),
    }


@everywhere
def test_every_layout_is_found_as_in_a_folder(tmp_path, far):
    datasets = lay_out(tmp_path)
    root, _ = far(tmp_path)
    for local, dataset in datasets.items():
        assert dataset.index(root / local.name, None).equals(dataset.index(local, None)), local.name
    depth = "000/point_cloud/LIDAR/7.npz#CAM"
    local = tmp_path / "ddad"
    read = datasets[local].read_depth
    np.testing.assert_array_equal(read(root / "ddad" / depth), read(local / depth))


@everywhere
def test_a_path_reads_like_one_of_a_folder(tmp_path, far):
    write(tmp_path, "a/b.txt", "text")
    write(tmp_path, "a/c/d.txt", "more")
    root, _ = far(tmp_path)
    assert (root / "a" / "b.txt").read_text() == "text"
    assert (root / "a/c/d.txt").open().read() == b"more"
    assert [(p.name, p.is_dir(), p.is_file()) for p in (root / "a").iterdir()] == [
        ("b.txt", False, True),
        ("c", True, False),
    ]
    assert [str(p) for p in root.glob("*/?.txt")] == [f"{root}/a/b.txt"]
    assert [str(p) for p in root.glob("*/*/d.*")] == [f"{root}/a/c/d.txt"]
    assert (root / "a").is_dir() and not (root / "a").is_file() and (root / "a/c").exists()
    assert not (root / "x").exists() and not (root / "a/b.txt").is_dir()
    assert (root / "a/b.txt").with_name("z") == root / "a" / "z" and (root / "a").parent == root
    assert pickle.loads(pickle.dumps(root / "a")) == root / "a"
    with pytest.raises(FileNotFoundError):
        (root / "a").read_bytes()
    with pytest.raises(RowError, match=r"^no such file$"):
        images.read_image(root / "x.png")


@everywhere
def test_the_size_of_an_image_is_read_from_its_header(tmp_path, far):
    noise = np.random.default_rng(0).integers(0, 255, (400, 300, 3), np.uint8)
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned by 90 degrees
    for name in ("a.jpg", "b.png", "c.webp", "d.tiff"):
        Image.fromarray(noise).save(tmp_path / name, **({"exif": exif} if name == "a.jpg" else {}))
    (tmp_path / "empty.jpg").write_bytes(b"")
    (tmp_path / "broken.jpg").write_bytes((tmp_path / "a.jpg").read_bytes()[:40])
    root, weather = far(tmp_path)
    for name in ("a.jpg", "b.png", "c.webp", "d.tiff"):
        assert images.image_size(root / name) == images.image_size(tmp_path / name), name
    for name in ("empty.jpg", "broken.jpg", "none.jpg"):
        with pytest.raises(RowError) as near:
            images.image_size(tmp_path / name)
        with pytest.raises(RowError, match=re.escape(str(near.value))):
            images.image_size(root / name)
    weather.seen = []
    images.image_size(root / "a.jpg")
    assert weather.seen == ["GET"]


def photos(root: Path) -> None:
    """Photographs with depth beside them: one broken, one of 1 x 1 px, one without depth."""
    rng = np.random.default_rng(0)
    for number in range(8):
        path = root / "rgb" / f"{number}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        size = (1, 1) if number == 5 else (40, 60)
        Image.fromarray(rng.integers(0, 255, (*size, 3), np.uint8)).save(path)
        if number != 6:
            (root / "depth").mkdir(exist_ok=True)
            depth = rng.integers(500, 5000, size, np.uint16)
            Image.fromarray(depth).save(root / "depth" / path.name)
    (root / "rgb" / "3.png").write_bytes(b"\x89PNG\r\n\x1a\nbroken")


GIVEN = {"images": "rgb", "depth": "depth", "depth_unit": "mm", "test_share": 0.25, "part_size": 3}


def made(work: WorkDir, root: Path, relative: Path, workers: int = 1) -> dict[str, bytes]:
    """The files of the tables that embed-images and depth make of a root."""
    name = chains.samples(work, "folder:photos", GIVEN, root=root)
    for stage, options in (
        ("embed-images", {"encoder": "thumbnail"}),
        ("depth", {"depth_model": f"files:{relative}", "pixels": 16}),
    ):
        job = jobs.job(work, stages.bind(stage, options), name, root=root)
        summary = runs.run(job, bar=rooms.NoBar, engine=EngineOptions(workers=workers))
        assert not summary.undone
    names = [f"{t}/{n}" for t in work.tables(name) for n in work.store.list(f"{name}/{t}")]
    kept = [n for n in names if not n.endswith(("/", "local.json"))]
    return {n: work.store.read(f"{name}/{n}") for n in kept}


@pytest.fixture
def relative(tmp_path):
    """Relative depth of `photos`."""
    place = tmp_path / "relative"
    (place / "rgb").mkdir(parents=True)
    for number in range(8):
        np.save(place / "rgb" / f"{number}.npy", np.linspace(0.1, 1, 2400).reshape(40, 60))
    return place


@everywhere
@pytest.mark.parametrize("workers", [1, 2])
def test_stages_write_the_bytes_that_a_folder_gives_in_any_weather(
    tmp_path, far, relative, workers
):
    photos(tmp_path / "photos")
    expected = made(WorkDir(tmp_path / "near"), tmp_path / "photos", relative)
    root, weather = far(tmp_path / "photos")
    weather.seen = []
    weather.troubles = ["503", "", "half", "cut", "", "lost", ""] * 6
    assert made(WorkDir(tmp_path / "far"), root, relative, workers) == expected
    assert {"503", "cut", "half"} <= {kind.partition(" ")[2] for kind in weather.seen}
    errors = WorkDir(tmp_path / "far").table("photos", "embeddings/images/thumbnail")
    failed = [e for n in errors.parts() for e in errors.read(n)["error"].to_pylist() if e]
    assert len(failed) == 1 and failed[0].startswith("rgb/3.png: unreadable PNG image")


@everywhere
def test_the_root_is_remembered(tmp_path, far, relative):
    photos(tmp_path / "photos")
    root, _ = far(tmp_path / "photos")
    work = WorkDir(tmp_path / "work")
    chains.samples(work, "folder:photos", GIVEN, root=root)
    assert index.find_root(work, "photos") == root
    assert jobs.job(work, THUMBNAILS, "photos").root == str(root)


@pytest.mark.parametrize("far", ["s3"], indirect=True)
def test_a_public_bucket_is_read_without_an_account_and_not_written(tmp_path, far, monkeypatch):
    write(tmp_path / "public", "a.txt", "text")
    place, weather = far(tmp_path / "public")
    key = f"{str(place).removeprefix('s3://bucket/')}/a.txt"
    pytest.importorskip("boto3").client("s3").put_object_acl(
        Bucket="bucket", Key=key, ACL="public-read"
    )
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    weather.signed = []
    store = ObjectStore(str(place), "--root")
    assert store.read("a.txt") == b"text"
    assert weather.signed == [False]
    with pytest.raises(RsaDataError, match=r"cannot write .*credentials"):
        ObjectStore(str(place)).write("b.txt", b"data")


@pytest.mark.parametrize("far", ["s3", "http"], indirect=True)
def test_a_server_that_stays_away_leaves_the_part_undone(tmp_path, far, monkeypatch):
    photos(tmp_path / "photos")
    for module in ("objects", "http"):
        monkeypatch.setattr(f"rsa_data.store.{module}.TRIES", 2)
    root, weather = far(tmp_path / "photos")
    work = WorkDir(tmp_path / "work")
    name = chains.samples(work, "folder:photos", GIVEN, root=root)
    weather.troubles = ["503"] * 200
    job = jobs.job(work, THUMBNAILS, name, root=root)
    summary = runs.run(job, bar=rooms.NoBar)
    weather.troubles = []
    assert summary.undone and "503" in str(summary.undone[0])
    assert work.table(name, "embeddings/images/thumbnail").parts() == []


@pytest.mark.parametrize("far", ["http"], indirect=True)
def test_a_list_stands_for_pages_that_the_server_does_not_make(tmp_path, far, site):
    photos(tmp_path / "photos")
    root, proxy = far(tmp_path / "photos")
    (site[0] / "silent").symlink_to(site[0] / str(root).rpartition("/")[2])
    root = open_root(f"http://127.0.0.1:{proxy.server_address[1]}/site/silent")
    with pytest.raises(RsaDataError, match=r"403 Forbidden; .*file_list=FILE"):
        folder().index(root, None)
    listed = tmp_path / "list.txt"
    listed.write_text("rgb/1.png\n/rgb/4.png\ndepth/4.png\n\nrgb/1.png\n")
    options = {"images": "rgb", "depth": "depth", "depth_unit": "mm"}
    table = folder(**options, file_list=listed).index(root, None)
    assert table.select(["sample_id", "image", "depth"]).to_pylist() == [
        {"sample_id": "folder/train/1", "image": "rgb/1.png", "depth": None},
        {"sample_id": "folder/train/4", "image": "rgb/4.png", "depth": "depth/4.png"},
    ]
    assert images.read_image(root / "rgb/1.png").shape == (40, 60, 3)


@pytest.mark.parametrize("far", ["http"], indirect=True)
def test_a_file_that_is_refused_is_a_failed_row(far, tmp_path):
    photos(tmp_path / "photos")
    _, proxy = far(tmp_path / "photos")
    root = open_root(f"http://127.0.0.1:{proxy.server_address[1]}/site/kept")
    with pytest.raises(RowError, match=r"^the server answers 403 Forbidden$"):
        images.read_image(root / "1.png")


def test_nobody_there_is_a_transient_error(monkeypatch):
    monkeypatch.setattr("rsa_data.store.http.TRIES", 0)
    with pytest.raises(TransientError, match=r"cannot read http://127.0.0.1:9/x: .*refused"):
        images.read_bytes(open_root("http://127.0.0.1:9") / "x")


@pytest.mark.parametrize(
    ("place", "reason"),
    [
        ("https://", "expected https://HOST/PATH"),
        ("https://me:secret@host/x", "without user name"),
        ("https://host/x?token=1", "without user name, . and #"),
        ("s3://", "--root s3://: expected s3://BUCKET/PREFIX"),
        ("gs://", "--root gs://: expected gs://BUCKET/PREFIX"),
        (
            "ftp://host/x",
            "expected a folder or one of s3://, gs://, az://, hf://, https://, http://",
        ),
    ],
)
def test_other_addresses_are_refused(place, reason):
    with pytest.raises(RsaDataError, match=reason):
        open_root(place)


def test_a_dataset_that_is_made_needs_a_folder(tmp_path):
    with pytest.raises(UsageError, match="writes its files: expected a folder"):
        chains.samples(
            WorkDir(tmp_path), "synthetic-indoor", {}, root=open_root("https://example.org/x")
        )


def test_a_root_far_away_is_read_by_more_threads(tmp_path):
    assert readers(tmp_path) == 2 and readers(open_root("https://example.org/x")) == 16


@pytest.mark.parametrize("text", [b"/x\x1b[31m\n/y", b"/tmp/\0x", b"/a" * 5000, b"/\xff\n", b""])
def test_a_damaged_note_of_the_root_is_refused(tmp_path, text):
    work = WorkDir(tmp_path)
    work.store.write("own/root.txt", text)
    with pytest.raises(RsaDataError, match=r"own/root\.txt: expected where .* Give --root PLACE"):
        index.find_root(work, "own")


def test_a_root_that_is_no_utf8_is_refused():
    with pytest.raises(UsageError, match=r"root: expected a name in UTF-8; found 'a\\udcff'"):
        open_root("a\udcff")
