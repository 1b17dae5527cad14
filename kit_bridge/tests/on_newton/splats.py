"""A renderer of Gaussian splats in torch, slow and small, with the interface of `gsplat.rasterization`.

Each splat is projected with the derivative of the projection at its centre, and drawn from front to back.
"""

import torch

LEAST_PX2 = 0.3
"""Added to each splat's covariance, as gsplat does, so that none is missed between two pixels."""


def rasterization(
    means,
    quats,
    scales,
    opacities,
    colors,
    viewmats,
    Ks,
    width,
    height,
    sh_degree=None,
    render_mode="RGB",
    rasterize_mode="classic",
):
    assert render_mode == "RGB+ED" and sh_degree == 0 and len(viewmats) == len(Ks) == 1
    view, matrix = viewmats[0], Ks[0]
    assert torch.allclose(view[3], torch.tensor([0.0, 0, 0, 1])) and torch.linalg.det(view[:3, :3]) > 0.99
    places = means @ view[:3, :3].T + view[:3, 3]
    order = torch.argsort(places[:, 2])
    order = order[places[order, 2] > 0.05]
    x, y, z = places[order].unbind(dim=1)
    fx, fy, (cx, cy) = matrix[0, 0], matrix[1, 1], matrix[:2, 2]
    middle = torch.stack([fx * x / z + cx, fy * y / z + cy], dim=1)
    none = torch.zeros_like(z)
    slope = torch.stack([fx / z, none, -fx * x / z**2, none, fy / z, -fy * y / z**2], dim=1).reshape(-1, 2, 3)
    sizes = slope @ view[:3, :3] @ rotations(quats[order]) * scales[order][:, None]
    spread = sizes @ sizes.transpose(1, 2)
    wider = spread + LEAST_PX2 * torch.eye(2)
    shrunk = (torch.linalg.det(spread) / torch.linalg.det(wider)).clamp(min=0).sqrt()
    # Pixels' centres are at halves.
    across, down = torch.meshgrid(torch.arange(width) + 0.5, torch.arange(height) + 0.5, indexing="xy")
    away = torch.stack([across, down], dim=-1).reshape(-1, 2) - middle[:, None]
    reach = torch.einsum("spi,sij,spj->sp", away, torch.linalg.inv(wider), away)
    shown = opacities[order] * (shrunk if rasterize_mode == "antialiased" else 1.0)
    alpha = (shown[:, None] * torch.exp(-0.5 * reach)).clamp(max=0.999)
    alpha = torch.where(alpha < 1 / 255, torch.zeros_like(alpha), alpha)
    left = torch.cumprod(torch.cat([torch.ones_like(alpha[:1]), 1 - alpha]), dim=0)
    weights = left[:-1] * alpha
    opacity = weights.sum(dim=0)
    colour = weights.T @ (0.5 + 0.28209479177387814 * colors[order, 0]).clamp(min=0)
    depth = weights.T @ z / opacity.clamp(min=1e-10)
    image = torch.cat([colour, depth[:, None]], dim=1).reshape(1, height, width, 4)
    return image, opacity.reshape(1, height, width, 1), {}


def rotations(quaternions):
    """Of quaternions w x y z."""
    w, x, y, z = quaternions.unbind(dim=1)
    rows = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return torch.stack(rows, dim=1).reshape(-1, 3, 3)
