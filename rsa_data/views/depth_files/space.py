"""Metric depth in space: coloured points as PLY, a textured mesh as GLB."""

from typing import NamedTuple

import numpy as np

# fx, fy, cx, cy in px.
Intrinsics = tuple[float, float, float, float]

# Points and vertices at most: what viewers open at once, and some tens of MB.
MOST = 1_000_000
# Neighbours whose depths differ by more than this factor are not of one surface.
_EDGE = 1.08
# px of a texture's longer side at most.
_TEXTURE = 2048


class Solid(NamedTuple):
    """A file of points or of a mesh, and what it holds and leaves out, in words."""

    data: bytes
    told: str


def _grid(
    depth: np.ndarray, camera: Intrinsics, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns of the pixels that are taken, and their points (rows, columns, 3), m."""
    step = max(1, int(np.ceil(np.sqrt(depth.size / most))))
    v, u = np.arange(0, depth.shape[0], step), np.arange(0, depth.shape[1], step)
    z = depth[np.ix_(v, u)].astype(np.float64)
    fx, fy, cx, cy = camera
    with np.errstate(invalid="ignore"):
        x, y = (u[None] - cx) / fx * z, (v[:, None] - cy) / fy * z
    return v, u, np.stack([x, y, z], -1)


def _thinned(depth: np.ndarray, v: np.ndarray, what: str, most: int) -> str:
    """That not every pixel was taken, or nothing."""
    step = int(v[1] - v[0]) if len(v) > 1 else 1
    if step == 1:
        return ""
    return f"; one pixel of {step} x {step} taken, for at most {most:,} {what}"


def ply(
    depth: np.ndarray, camera: Intrinsics, colours: np.ndarray | None = None, most: int = MOST
) -> Solid:
    """A point for each pixel of finite depth, at most `most`: x right, y down, z forward, m.

    depth : float (h, w), m. camera : fx, fy, cx, cy in px of it.
    colours : uint8 (h, w, 3), RGB.
    """
    v, u, points = _grid(depth, camera, most)
    good = np.isfinite(points[..., 2]) & (points[..., 2] > 0)
    columns = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    if colours is not None:
        columns += [("red", "u1"), ("green", "u1"), ("blue", "u1")]
    rows = np.zeros(int(good.sum()), columns)
    for i, name in enumerate("xyz"):
        rows[name] = points[good][:, i]
    if colours is not None:
        own = colours[np.ix_(v, u)][good]
        for i, name in enumerate(("red", "green", "blue")):
            rows[name] = own[:, i]
    kinds = {"<f4": "float", "u1": "uchar"}
    header = "".join(f"property {kinds[kind]} {name}\n" for name, kind in columns)
    start = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{header}end_header\n"
    )
    told = f"{len(rows):,} points; {_blank(good)}{_thinned(depth, v, 'points', most)}"
    return Solid(start.encode() + rows.tobytes(), told)


def _blank(good: np.ndarray) -> str:
    """How many pixels have no point."""
    blank = int(good.size - good.sum())
    return f"{blank:,} pixels without a depth left out ({blank / good.size:.0%})"


def glb(depth: np.ndarray, camera: Intrinsics, colours: np.ndarray, most: int = MOST // 4) -> Solid:
    """A mesh with the photo as its texture, cut where the depth jumps: y up, z to the viewer, m.

    As `ply`; raises ValueError when no three neighbours have a depth.
    """
    import trimesh
    from PIL import Image
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    v, u, points = _grid(depth, camera, most)
    z = points[..., 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        log = np.where(np.isfinite(z) & (z > 0), np.log(z), np.nan)
    number = np.arange(z.size).reshape(z.shape)
    corner, right, below, across = (
        part.ravel()
        for part in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
    )
    faces = np.concatenate(
        [np.stack([corner, below, right], 1), np.stack([right, below, across], 1)]
    )
    spread = np.ptp(log.ravel()[faces], axis=1)
    jumps = int((spread > np.log(_EDGE)).sum())
    faces = faces[spread <= np.log(_EDGE)]  # nan is not below it
    if not len(faces):
        raise ValueError("no three neighbouring pixels have a depth on one surface")
    used, faces = np.unique(faces, return_inverse=True)
    height, width = depth.shape
    across_share = np.broadcast_to((u + 0.5) / width, z.shape).ravel()[used]
    down_share = np.broadcast_to(((v + 0.5) / height)[:, None], z.shape).ravel()[used]
    photo = Image.fromarray(colours)
    photo.thumbnail((_TEXTURE, _TEXTURE))
    material = PBRMaterial(  # type: ignore[no-untyped-call]
        baseColorTexture=photo, metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True
    )
    mesh = trimesh.Trimesh(
        vertices=points.reshape(-1, 3)[used] * [1, -1, -1],
        faces=faces.reshape(-1, 3),
        visual=TextureVisuals(  # type: ignore[no-untyped-call]
            uv=np.stack([across_share, 1 - down_share], 1), material=material
        ),
        process=False,
    )
    data = mesh.export(file_type="glb")
    assert isinstance(data, bytes)
    told = (
        f"{faces.size // 3:,} triangles; {_blank(np.isfinite(log))}; cut at {jumps:,} triangles "
        f"whose depth jumps by more than {_EDGE - 1:.0%}{_thinned(depth, v, 'corners', most)}"
    )
    return Solid(data, told)
