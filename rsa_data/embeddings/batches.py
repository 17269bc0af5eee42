"""Batches of texts with little to compute, the same for the same texts whoever computes them.

Two plans. `by_length` suits any encoder: texts of like length together, so that little is padding.
`by_prefix` is for encoders with causal attention, where a token's state follows from the tokens
before it alone: texts that begin alike stand together, and a beginning that several share is
computed once.
"""

from collections.abc import Iterator

import numpy as np

from .encoder import Batch, Ids

LENGTH_AXES = {"ids": ("b", "t"), "lengths": ("b",)}
PREFIX_AXES = {
    "ids": ("m",),
    "positions": ("m",),
    "paths": ("b", "t"),
    "places": ("m",),
    "ends": ("b",),
}


def by_length(ids: Ids, budget: int) -> Iterator[Batch]:
    """Batches of texts sorted by length (ties by row), longest first.

    ids : tokens of each text, start and end included.
    budget : tokens of a batch, padding included; a text longer than it gets a batch of its own.

    Inputs: `ids`, int64 of shape (b, t), padded with 0, and `lengths`, int64 of shape (b,).
    Longest first, so that what a batch needs of memory is known from the first one. Padding is 1 to
    3% of the tokens of released captions, and attention a ninth of MiniLM's time, so that texts put
    end to end without padding could save little.
    """
    lengths = _lengths(ids)
    order = np.argsort(-lengths, kind="stable")
    start = 0
    while start < len(order):
        stop = start + max(1, budget // max(1, int(lengths[order[start]])))
        rows = order[start:stop]
        yield rows, {"ids": _grid([ids[row] for row in rows], 0), "lengths": lengths[rows]}
        start = stop


def by_prefix(ids: Ids, budget: int) -> Iterator[Batch]:
    """Batches of texts in the order of their tokens, as trees of their shared beginnings.

    A node is a token with all that stands before it; a text is a path from the root. Per-token
    work is done once a node, attention once a text over the path of its nodes.

    budget : nodes of a batch; a text with more gets a batch of its own.

    Inputs, for m nodes and b texts of at most t tokens, all int64:
    `ids`, shape (m,): a node's token; `positions`, shape (m,): how many tokens stand before it;
    `paths`, shape (b, t): a text's nodes, behind its end 0; `places`, shape (m,): where in the
    flattened `paths` a node stands (one of the places); `ends`, shape (b,): a text's last node.
    """
    if not ids:
        return
    lengths = _lengths(ids)
    grid = _grid(ids, -1)
    # lexsort takes its last key first.
    order = np.lexsort(grid.T[::-1])
    grid, lengths = grid[order], lengths[order]
    same = np.zeros(grid.shape, bool)
    same[1:] = np.logical_and.accumulate(grid[1:] == grid[:-1], axis=1)
    # Tokens shared with the text before; padding is equal to padding but is no token.
    shared = np.minimum(same.sum(1), lengths)
    for start, stop in _cuts(lengths, shared, budget):
        length = lengths[start:stop]
        common = shared[start:stop].copy()
        common[0] = 0
        yield order[start:stop], _tree(grid[start:stop, : length.max()], length, common)


def _lengths(ids: Ids) -> np.ndarray:
    return np.fromiter(map(len, ids), np.int64, len(ids))


def _grid(ids: Ids, pad: int) -> np.ndarray:
    """Tokens of the texts as int64 of shape (n, longest), filled up with `pad`."""
    lengths = _lengths(ids)
    grid = np.full((len(ids), int(lengths.max())), pad, np.int64)
    grid[np.arange(grid.shape[1]) < lengths[:, None]] = np.concatenate(ids)
    return grid


def _cuts(lengths: np.ndarray, shared: np.ndarray, budget: int) -> Iterator[tuple[int, int]]:
    """First and last row of each batch, so that a batch has at most `budget` nodes."""
    start, nodes = 0, 0
    for row, (length, common) in enumerate(zip(lengths.tolist(), shared.tolist(), strict=True)):
        if row > start and nodes + length - common > budget:
            yield start, row
            start, nodes = row, 0
        nodes += length if row == start else length - common
    yield start, len(lengths)


def _tree(grid: np.ndarray, lengths: np.ndarray, shared: np.ndarray) -> dict[str, np.ndarray]:
    """The inputs of one batch from its sorted rows; `shared` of the first row is 0."""
    rows, columns = np.arange(len(grid)), np.arange(grid.shape[1])
    # The node at (row, column) was made by the last row up to here that shares no more than
    # `column` tokens with the one before it.
    makes = shared[:, None] <= columns  # (b, t)
    maker = np.maximum.accumulate(np.where(makes, rows[:, None], 0), axis=0)  # (b, t)
    offset = np.concatenate([[0], np.cumsum(lengths - shared)[:-1]]) - shared  # (b,)
    inside = columns < lengths[:, None]  # (b, t)
    paths = np.where(inside, offset[maker] + columns, 0)  # (b, t)
    new = makes & inside
    return {
        "ids": grid[new],
        "positions": np.broadcast_to(columns, grid.shape)[new],
        "paths": paths,
        "places": np.flatnonzero(new),
        "ends": paths[rows, lengths - 1],
    }
