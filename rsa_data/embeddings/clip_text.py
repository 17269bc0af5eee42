"""CLIP's text tower (OpenAI, 2021): the whole network, with the parameter names of its checkpoints.

A pre-norm transformer with causal attention; the feature is the end-of-text token's row after the
last LayerNorm, times `text_projection`. Because attention is causal, a token's state follows from
the tokens before it: nothing behind the end token is computed, and what several texts begin with
is computed once for all of them.
"""

import torch
from torch import nn
from torch.nn import functional as F


class Attention(nn.Module):
    """Causal self-attention with the query, key and value weights in one matrix."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.in_proj_weight = nn.Parameter(torch.zeros(3 * width, width))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * width))
        self.out_proj = nn.Linear(width, width)

    def forward(self, x: torch.Tensor, paths: torch.Tensor, places: torch.Tensor) -> torch.Tensor:
        """Every node sees the nodes before it on its path. x : (m, width). Returns (m, width)."""
        x = F.linear(x, self.in_proj_weight, self.in_proj_bias)  # (m, 3 * width)
        q, k, v = self._along(x, paths, 3)  # (heads, b, t, width / heads)
        x = F.scaled_dot_product_attention(q, k, v, is_causal=True)
        x = x.flatten(1, 2).index_select(1, places)  # (heads, m, width / heads)
        x = self.out_proj(x.transpose(0, 1).flatten(1))  # (m, width)
        return x

    def at_ends(self, x: torch.Tensor, paths: torch.Tensor, ends: torch.Tensor) -> torch.Tensor:
        """The same for the texts' last nodes only. x : (m, width). Returns (b, width)."""
        width = x.shape[1]
        weight, bias = self.in_proj_weight, self.in_proj_bias
        q = F.linear(x[ends], weight[:width], bias[:width])  # (b, width)
        q = q.view(ends.shape[0], self.heads, 1, -1).transpose(0, 1)  # (heads, b, 1, width / heads)
        k, v = self._along(F.linear(x, weight[width:], bias[width:]), paths, 2)
        # Nodes are numbered upwards along a path, and behind its end stands node 0.
        seen = (paths > 0) | (torch.arange(paths.shape[1], device=x.device) == 0)  # (b, t)
        x = F.scaled_dot_product_attention(q, k, v, attn_mask=seen[:, None])
        x = self.out_proj(x.squeeze(2).transpose(0, 1).flatten(1))  # (b, width)
        return x

    def _along(self, x: torch.Tensor, paths: torch.Tensor, parts: int) -> torch.Tensor:
        """Rows of nodes, (m, parts * width), to (parts, heads, b, t, width / heads)."""
        # The few nodes are brought into the order that attention wants, before they are repeated.
        x = x.view(x.shape[0], parts, self.heads, -1).permute(1, 2, 0, 3)
        return torch.unflatten(x.index_select(2, paths.flatten()), 2, paths.shape)


class Mlp(nn.Module):
    """Two linear maps with QuickGELU between them."""

    def __init__(self, width: int):
        super().__init__()
        self.c_fc = nn.Linear(width, 4 * width)
        self.c_proj = nn.Linear(4 * width, width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = self.c_fc(x)  # (b, t, 4 * width)
        # QuickGELU: the approximation that CLIP was trained with.
        x = self.c_proj(x * torch.sigmoid(1.702 * x))  # (b, t, width)
        return x


class Block(nn.Module):
    """One pre-norm transformer layer."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.ln_1, self.ln_2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attn, self.mlp = Attention(width, heads), Mlp(width)

    def forward(self, x: torch.Tensor, paths: torch.Tensor, places: torch.Tensor) -> torch.Tensor:
        x = x + self.attn(self.ln_1(x), paths, places)
        x = x + self.mlp(self.ln_2(x))
        return x

    def at_ends(self, x: torch.Tensor, paths: torch.Tensor, ends: torch.Tensor) -> torch.Tensor:
        x = x[ends] + self.attn.at_ends(self.ln_1(x), paths, ends)
        x = x + self.mlp(self.ln_2(x))
        return x


class TextTower(nn.Module):
    """Texts to features that are not normalised; the default sizes are those of CLIP RN50."""

    def __init__(
        self,
        *,
        width: int = 512,
        heads: int = 8,
        layers: int = 12,
        context: int = 77,
        vocabulary: int = 49408,
        dim: int = 1024,
    ):
        super().__init__()
        self.token_embedding = nn.Embedding(vocabulary, width)
        self.positional_embedding = nn.Parameter(torch.zeros(context, width))
        self.blocks = [Block(width, heads) for _ in range(layers)]
        self.transformer = nn.ModuleDict({"resblocks": nn.ModuleList(self.blocks)})
        self.ln_final = nn.LayerNorm(width)
        self.text_projection = nn.Parameter(torch.zeros(width, dim))

    def forward(
        self,
        ids: torch.Tensor,
        positions: torch.Tensor,
        paths: torch.Tensor,
        places: torch.Tensor,
        ends: torch.Tensor,
    ) -> torch.Tensor:
        """Features of b texts that are a tree of m nodes: see batches.by_prefix for the inputs.

        Returns float of shape (b, dim), not normalised.
        """
        x = self.token_embedding(ids) + self.positional_embedding[positions]  # (m, width)
        for block in self.blocks[:-1]:
            x = block(x, paths, places)
        # Of the last layer only the end tokens' rows are read.
        x = self.blocks[-1].at_ends(x, paths, ends)  # (b, width)
        features: torch.Tensor = self.ln_final(x) @ self.text_projection  # (b, dim)
        return features
