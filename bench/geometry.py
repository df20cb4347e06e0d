"""Procedural meshes and transforms of the bench scenes. Used by make_scenes.py."""

import numpy as np


def icosphere(level):
    t = (1 + 5**0.5) / 2
    V = np.array(
        [
            [-1, t, 0],
            [1, t, 0],
            [-1, -t, 0],
            [1, -t, 0],
            [0, -1, t],
            [0, 1, t],
            [0, -1, -t],
            [0, 1, -t],
            [t, 0, -1],
            [t, 0, 1],
            [-t, 0, -1],
            [-t, 0, 1],
        ],
        float,
    )
    F = np.array(
        [
            [0, 11, 5],
            [0, 5, 1],
            [0, 1, 7],
            [0, 7, 10],
            [0, 10, 11],
            [1, 5, 9],
            [5, 11, 4],
            [11, 10, 2],
            [10, 7, 6],
            [7, 1, 8],
            [3, 9, 4],
            [3, 4, 2],
            [3, 2, 6],
            [3, 6, 8],
            [3, 8, 9],
            [4, 9, 5],
            [2, 4, 11],
            [6, 2, 10],
            [8, 6, 7],
            [9, 8, 1],
        ]
    )
    for _ in range(level):
        E = np.sort(np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]), axis=1)
        E, inv = np.unique(E, axis=0, return_inverse=True)
        a, b, c = inv.reshape(-1).reshape(3, -1) + len(V)
        V = np.vstack([V, (V[E[:, 0]] + V[E[:, 1]]) / 2])
        F = np.concatenate(
            [np.stack(x, 1) for x in ((F[:, 0], a, c), (F[:, 1], b, a), (F[:, 2], c, b), (a, b, c))]
        )
        V /= np.linalg.norm(V, axis=1, keepdims=True)
    return V / np.linalg.norm(V, axis=1, keepdims=True), F


def sphere_uv(D):
    return np.stack(
        [
            0.5 + np.arctan2(D[:, 1], D[:, 0]) / (2 * np.pi),
            np.arccos(np.clip(D[:, 2], -1, 1)) / np.pi,
        ],
        1,
    )


def smooth_normals(P, F):
    n = np.cross(P[F[:, 1]] - P[F[:, 0]], P[F[:, 2]] - P[F[:, 0]])
    N = np.stack(
        [sum(np.bincount(F[:, k], n[:, a], len(P)) for k in range(3)) for a in range(3)], 1
    )
    return N / np.maximum(np.linalg.norm(N, axis=1, keepdims=True), 1e-20)


def blob(rng, level, octaves=3, amp=0.35, freq=1.5):
    """Icosphere displaced by sums of sines: a closed random mesh within about unit radius."""
    D, F = icosphere(level)
    r = np.ones(len(D))
    a = amp
    f = freq
    for _ in range(octaves):
        for _ in range(3):
            w = rng.normal(size=3)
            w *= f / np.linalg.norm(w)
            r += a / 3 * np.sin(D @ w * np.pi + rng.uniform(0, 6.283))
        a *= 0.5
        f *= 2
    P = D * (r / r.max())[:, None] * rng.uniform(0.6, 1.0, 3)
    return P, smooth_normals(P, F), sphere_uv(D), F


def torus(R=0.7, r=0.3, n=64, m=32):
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    u, v = u.ravel(), v.ravel()
    N = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], 1)
    P = np.stack([R * np.cos(u), R * np.sin(u), 0 * u], 1) + r * N
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")

    def q(a, b):
        return ((i + a) % n * m + (j + b) % m).ravel()

    F = np.concatenate(
        [np.stack([q(0, 0), q(1, 0), q(1, 1)], 1), np.stack([q(0, 0), q(1, 1), q(0, 1)], 1)]
    )
    return P, N, np.stack([u, v], 1) / (2 * np.pi), F


def quad():  # unit square in XY, facing +Z
    P = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    return P, np.tile([0.0, 0, 1], (4, 1)), P[:, :2] + 0.5, np.array([[0, 1, 2], [0, 2, 3]])


def box():
    qs = []
    for ax in range(3):
        for s in (-1, 1):
            P, _, UV, F = quad()
            n = np.zeros(3)
            n[ax] = s
            t = np.roll(n, 1) * s
            b = np.cross(n, t)
            qs.append(
                (P[:, :1] * t + P[:, 1:2] * b + n * 0.5, np.tile(n, (4, 1)), UV, F + 4 * len(qs))
            )
    return tuple(np.concatenate([q[k] for q in qs]) for k in range(4))


# ---------------------------------------------------------------- transforms
# Row-major 4x4, column vectors.
def T(t=(0, 0, 0), s=1.0, R=None):
    M = np.eye(4)
    M[:3, :3] = (np.eye(3) if R is None else R) * np.broadcast_to(s, 3)[None, :]
    M[:3, 3] = t
    return M


def random_rot(rng):
    q = rng.normal(size=4)
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def facing(d):  # rotation taking +Z to d
    d = np.asarray(d, float)
    d = d / np.linalg.norm(d)
    a = np.array([1.0, 0, 0]) if abs(d[0]) < 0.9 else np.array([0, 1.0, 0])
    x = np.cross(a, d)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(d, x), d], 1)


def look_at(eye, target):  # camera: -Z forward, +Y up; world up +Z
    eye = np.asarray(eye, float)
    z = eye - np.asarray(target, float)
    z /= np.linalg.norm(z)
    x = np.cross([0, 0, 1.0], z)
    x /= np.linalg.norm(x)
    M = np.eye(4)
    M[:3, :3] = np.stack([x, np.cross(z, x), z], 1)
    M[:3, 3] = eye
    return M
