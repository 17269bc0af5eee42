"""What lies in a folder: as web servers' pages list it, and as a bucket does."""

import asyncio
from pathlib import Path

from rsa_data.store.bucket_listing import listed
from rsa_data.store.http import names


def test_links_of_a_page():
    page = b"""<a href="../">Parent</a> <a href="?C=N;O=D">Name</a> <a href="http://[half">x</a>
      <a href="a%20b.png">a</a> <a href="c/">c</a> <a href="c/d.png">d</a> <a href="#top">t</a>
      <a href="http://there/x/e.png">e</a> <a href="http://else/x/f.png">f</a> <a name="n">n</a>"""
    assert names(page, "http://there/x/") == ["a b.png", "c/", "e.png"]


class Bucket:
    """obstore's form of a listing, after a moment."""

    async def list_with_delimiter_async(self, prefix):
        await asyncio.sleep(0.15)
        return {"common_prefixes": [f"{prefix}/c"], "objects": [{"path": f"{prefix}/b.png"}]}


def test_a_bucket_is_listed_where_memory_is_not_told(monkeypatch):
    """Systems without /proc, such as macOS."""
    read = Path.read_text

    def without(path, *arguments):
        if path.parts[:2] == ("/", "proc"):
            raise FileNotFoundError(path)
        return read(path, *arguments)

    monkeypatch.setattr(Path, "read_text", without)
    assert listed(Bucket(), "a") == ["a/b.png", "a/c/"]
