"""A linear Delta, as of printers: three carriages on towers, six rods, and its closed form, three spheres."""

import numpy as np

import p3dof

RADIUS, ARM, HEIGHT, WIDTH = 0.12, 0.29, 0.35, 0.02
"""From the middle to the joints of the rods, horizontally, tool in the middle; rods; end stops [m]."""
ANGLES = np.radians([210.0, 330.0, 90.0])
PLATE = 0.03  # radius of the platform's joints [m]


def linear_delta():
    """A robot whose carriages are at the heights of the rods' upper joints; rods are distances."""
    joints = ['<joint name="free" type="floating"><parent link="base"/><child link="plate"/></joint>']
    links = [link("base"), link("plate"), link("tool"), fixed("tool", "plate", (0, 0, 0))]
    closures, lengths = [], []
    for tower, angle in zip("abc", ANGLES, strict=True):
        out, across = (
            np.array([np.cos(angle), np.sin(angle), 0]),
            np.array([-np.sin(angle), np.cos(angle), 0]),
        )
        x, y, _ = ((RADIUS + PLATE) * out).tolist()
        joints.append(
            f'<joint name="tower_{tower}" type="prismatic"><parent link="base"/>'
            f'<child link="carriage_{tower}"/>'
            f'<origin xyz="{x!r} {y!r} 0"/><axis xyz="0 0 1"/>'
            '<limit lower="0" upper="0.6" effort="100" velocity="1"/></joint>'
        )
        links.append(link(f"carriage_{tower}"))
        for side, sign in (("l", 1.0), ("r", -1.0)):
            ends = [f"{end}_{tower}_{side}" for end in ("top", "seat")]
            links += [link(name) for name in ends]
            joints.append(fixed(ends[0], f"carriage_{tower}", sign * WIDTH * across))
            joints.append(fixed(ends[1], "plate", PLATE * out + sign * WIDTH * across))
            closures.append(ends)
            lengths.append(ARM)
    start = {f"tower_{tower}": HEIGHT for tower in "abc"} | {"free": [0, 0, HEIGHT - rise(), 0, 0, 0, 1]}
    sidecar = {
        "closed_loop": closures,
        "type": ["distance"] * 6,
        "length": lengths,
        "name_mot": [f"tower_{tower}" for tower in "abc"],
        "reference": start,
    }
    return p3dof.load_robot(f'<robot name="delta">{"".join(links + joints)}</robot>', sidecar)


def rise():
    return float(np.sqrt(ARM**2 - RADIUS**2))


def link(name):
    inertia = '<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'
    inner = f'<inertial><mass value="0.1"/>{inertia}</inertial>' if name[:3] in ("pla", "car") else ""
    return f'<link name="{name}">{inner}</link>'


def fixed(child, parent, at):
    x, y, z = (float(number) for number in at)
    return (
        f'<joint name="{child}_fixed" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x!r} {y!r} {z!r}"/></joint>'
    )


def spheres(heights, radius=RADIUS, arms=(ARM,) * 3, angles=ANGLES):
    """Where the tool is: the lower point that is an arm's length away from three points at the towers."""
    radius = np.broadcast_to(radius, 3)
    tops = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), heights])
    (p, q, r), (a, b, c) = tops, np.square(arms)
    x = (q - p) / np.linalg.norm(q - p)
    i = x @ (r - p)
    y = r - p - i * x
    y /= np.linalg.norm(y)
    d, j = np.linalg.norm(q - p), y @ (r - p)
    along = (a - b + d * d) / (2 * d)
    across = (a - c + i * i + j * j) / (2 * j) - i / j * along
    down = np.sqrt(a - along**2 - across**2)
    normal = np.cross(x, y)
    return p + along * x + across * y - np.copysign(down, normal[2]) * normal


def heights_of(point, radius=RADIUS, arms=(ARM,) * 3, angles=ANGLES):
    """The inverse: heights of the carriages for a position of the tool."""
    x, y, z = point
    radius = np.broadcast_to(radius, 3)
    away = (radius * np.cos(angles) - x) ** 2 + (radius * np.sin(angles) - y) ** 2
    return z + np.sqrt(np.square(arms) - away)
