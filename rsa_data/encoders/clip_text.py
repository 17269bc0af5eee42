"""CLIP's text tower (OpenAI, 2021): the whole network, with the parameter names of its checkpoints.

A pre-norm transformer with causal attention; the feature is the end-of-text token's row after the
last LayerNorm, times `text_projection`. Because attention is causal, what stands behind the end
token changes nothing, so a text is computed at its own length instead of 77.
"""

import torch
from torch import nn
from torch.nn import functional as F


class Attention(nn.Module):
    """Causal self-attention with the query, key and value weights in one matrix."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.heads = heads
        self.in_proj_weight = nn.Parameter(torch.empty(3 * width, width))
        self.in_proj_bias = nn.Parameter(torch.empty(3 * width))
        self.out_proj = nn.Linear(width, width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        b, t, width = x.shape
        x = F.linear(x, self.in_proj_weight, self.in_proj_bias)  # (b, t, 3 * width)
        q, k, v = x.view(b, t, 3, self.heads, -1).permute(2, 0, 3, 1, 4)  # (b, heads, t, -1)
        x = F.scaled_dot_product_attention(q, k, v, is_causal=True)
        return self.out_proj(x.transpose(1, 2).reshape(b, t, width))  # (b, t, width)


class Mlp(nn.Module):
    """Two linear maps with QuickGELU between them."""

    def __init__(self, width: int):
        super().__init__()
        self.c_fc = nn.Linear(width, 4 * width)
        self.c_proj = nn.Linear(4 * width, width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = self.c_fc(x)  # (b, t, 4 * width)
        # QuickGELU: the approximation that CLIP was trained with.
        return self.c_proj(x * torch.sigmoid(1.702 * x))  # (b, t, width)


class Block(nn.Module):
    """One pre-norm transformer layer."""

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.ln_1, self.ln_2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attn, self.mlp = Attention(width, heads), Mlp(width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = x + self.attn(self.ln_1(x))
        return x + self.mlp(self.ln_2(x))


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
        self.positional_embedding = nn.Parameter(torch.empty(context, width))
        blocks = nn.Sequential(*(Block(width, heads) for _ in range(layers)))
        self.transformer = nn.ModuleDict({"resblocks": blocks})
        self.ln_final = nn.LayerNorm(width)
        self.text_projection = nn.Parameter(torch.empty(width, dim))

    def forward(self, ids: torch.Tensor, lengths: torch.Tensor) -> torch.Tensor:
        """Features of texts.

        ids : int64 of shape (b, t), t at most the context; behind a text's end anything may stand.
        lengths : int64 of shape (b,), tokens of each text; its last one is the end-of-text token.

        Returns float of shape (b, dim).
        """
        x = self.token_embedding(ids) + self.positional_embedding[: ids.shape[1]]
        x = self.transformer["resblocks"](x)  # (b, t, width)
        x = x[torch.arange(len(ids), device=ids.device), lengths - 1]  # (b, width)
        return self.ln_final(x) @ self.text_projection  # (b, dim)
