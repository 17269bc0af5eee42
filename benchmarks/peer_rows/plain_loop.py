"""Occupancy captions as one would write them: every caption by itself, in a Python loop.

Plurals and tokens come from this project, so that the captions compare; the loop remembers the
tokens of each phrase that it has seen.
"""

import random
from collections.abc import Callable, Iterator, Sequence

from rsa_data.captions.words import word
from rsa_data.common.tokenizers import clip

DELETE = 0.2


def writer(
    variants: int,
) -> Callable[[Sequence[str], Sequence[float]], Iterator[tuple[int, str, int, int]]]:
    """(labels, areas) of an image -> variant, text, objects kept and tokens of each caption."""
    tokenizer, rng = clip(), random.Random(0)
    known: dict[str, int] = {}
    limit, around = tokenizer.max_tokens, int(tokenizer.count(["An image with"])[0])

    def write(labels: Sequence[str], areas: Sequence[float]) -> Iterator[tuple[int, str, int, int]]:
        largest = sorted(range(len(labels)), key=lambda i: -areas[i])
        for variant in range(variants):
            kept, used = [], around
            for i in largest:
                if variant and rng.random() < DELETE:
                    continue
                named = word(labels[i])
                verb = "occupy" if named.is_plural else "occupies"
                phrase = f"{named.name} {verb} {round(100 * areas[i], 2):.2f}% of the image"
                tokens = known.get(phrase)
                if tokens is None:
                    tokens = known[phrase] = int(tokenizer.count([phrase])[0]) - 2
                more = tokens + 1 if kept else tokens
                if used + more <= limit:
                    kept.append(phrase)
                    used += more
            if variant:
                rng.shuffle(kept)
            text = "An image with " + ", ".join(kept) if kept else "An image."
            yield variant, text, len(kept), used

    return write
