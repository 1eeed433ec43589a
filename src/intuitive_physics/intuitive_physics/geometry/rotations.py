"""Rotations as unit quaternions (x, y, z, w) and as matrices, for whole arrays at once.

`quaternions` has the same for kernels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def rotation_matrix(quaternions: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation matrices of unit quaternions.

    Parameters
    ----------
    quaternions : (…, 4) as (x, y, z, w)

    Returns
    -------
    array
        (…, 3, 3); its columns are the axes of the rotated frame
    """
    q = np.asarray(quaternions, dtype=np.float64)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    matrices = np.empty((*q.shape[:-1], 3, 3))
    matrices[..., 0, 0] = 1 - 2 * (y * y + z * z)
    matrices[..., 0, 1] = 2 * (x * y - z * w)
    matrices[..., 0, 2] = 2 * (x * z + y * w)
    matrices[..., 1, 0] = 2 * (x * y + z * w)
    matrices[..., 1, 1] = 1 - 2 * (x * x + z * z)
    matrices[..., 1, 2] = 2 * (y * z - x * w)
    matrices[..., 2, 0] = 2 * (x * z - y * w)
    matrices[..., 2, 1] = 2 * (y * z + x * w)
    matrices[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrices


def rotate_quaternions(quaternions: ArrayLike, rotation_vectors: ArrayLike) -> NDArray[np.float64]:
    """Rotate orientations by rotation vectors in the environment's axes.

    Parameters
    ----------
    quaternions : (…, 4) unit quaternions (x, y, z, w)
    rotation_vectors : (…, 3) rad, of a shape that broadcasts against that of the quaternions

    Returns
    -------
    array
        (…, 4) unit quaternions (x, y, z, w)
    """
    vectors = np.asarray(rotation_vectors, dtype=np.float64)
    angles = np.linalg.norm(vectors, axis=-1, keepdims=True)
    # sin(θ/2) / θ by NumPy's sinc(x) = sin(π x) / (π x), which is right at θ = 0 too.
    parts = 0.5 * np.sinc(angles / (2.0 * np.pi)) * vectors
    return quaternion_product(np.concatenate([parts, np.cos(0.5 * angles)], axis=-1), quaternions)


def quaternion_product(second: ArrayLike, first: ArrayLike) -> NDArray[np.float64]:
    """Return the rotations by `first`, then `second`; all (…, 4) as (x, y, z, w).

    Parameters
    ----------
    second, first : (…, 4) unit quaternions of shapes that broadcast
    """
    q2, q1 = np.asarray(second, dtype=np.float64), np.asarray(first, dtype=np.float64)
    x1, y1, z1, w1 = q2[..., 0], q2[..., 1], q2[..., 2], q2[..., 3]
    x2, y2, z2, w2 = q1[..., 0], q1[..., 1], q1[..., 2], q1[..., 3]
    product = np.empty((*np.broadcast_shapes(q2.shape[:-1], q1.shape[:-1]), 4))
    product[..., 0] = w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2
    product[..., 1] = w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2
    product[..., 2] = w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2
    product[..., 3] = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2
    return product
