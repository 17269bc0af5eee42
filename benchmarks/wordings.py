"""Structured, natural and mixed captions, by what can be measured without a trained head.

    python benchmarks/wordings.py RSA/text [--images 5000]

RSA/text : the texts that the RSA repository released: of each image ten lines by a vision-language
model (natural), then five structured ones. Mixed are all fifteen, of which training draws one at
random. Writes benchmarks/results/wordings.md: tokens, the share that CLIP's 77 tokens cut, and how
many captions are distinct, so have to be encoded.
"""

import argparse
from pathlib import Path

import numpy as np

from rsa_data.common.tokenizers import clip

KINDS = {"structured": slice(10, 15), "natural": slice(0, 10), "mixed": slice(0, 15)}


def main() -> None:
    """Prints and writes the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("text", type=Path)
    parser.add_argument("--images", type=int, default=5000, help="of each dataset, evenly")
    asked = parser.parse_args()
    tokenizer = clip()
    lines = [
        "| dataset | captions | of each image | tokens, mean | 95% below | longer than 77 "
        "| distinct | words in all |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for folder in sorted(p for p in (asked.text / "text_all").iterdir() if p.is_dir()):
        files = sorted(folder.rglob("*.txt"))
        files = files[:: max(1, len(files) // asked.images)]
        read = [[t for t in f.read_text("utf-8").split("\n") if t] for f in files]
        for kind, rows in KINDS.items():
            texts = [text for image in read for text in image[rows]]
            tokens = np.asarray(tokenizer.count(texts))
            words = len({word for text in texts for word in text.lower().split()})
            lines.append(
                f"| {folder.name}, {len(files):,} images | {kind} | {len(texts) / len(files):.0f} "
                f"| {tokens.mean():.1f} | {np.quantile(tokens, 0.95):.0f} "
                f"| {(tokens > 77).mean():.2%} | {len(set(texts)) / len(texts):.1%} | {words:,} |"
            )
    table = "\n".join(lines) + "\n"
    print(table)
    results = Path(__file__).parent / "results"
    results.mkdir(exist_ok=True)
    (results / "wordings.md").write_text(table, "utf-8")


if __name__ == "__main__":
    main()
