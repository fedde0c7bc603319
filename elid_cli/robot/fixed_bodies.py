"""Links of a URDF that are fixed to another, and what is said where that one gets their mass."""

from __future__ import annotations

from collections.abc import Sequence

from elid_cli.robot.urdf.read import link_inertia
from elid_cli.robot.urdf.xml import Element

HELD = ("fixed", "floating", "planar")
"""Types of joints whose links belong to the body before them."""


def fixed_to(root: Element, link: Element) -> list[Element]:
    """Return the links with a mass that a link of a URDF carries without a joint that moves."""
    links = {one.attributes.get("name"): one for one in root.all("link")}
    below: dict[str | None, list[Element]] = {}
    for joint in root.all("joint"):
        parent, child = joint.one("parent"), joint.one("child")
        if parent is not None and child is not None and joint.attributes.get("type") in HELD:
            below.setdefault(parent.attributes.get("link"), []).append(links[child.attributes.get("link")])
    found, at = [], [link]
    for carrier in at:
        for other in below.get(carrier.attributes.get("name"), ()):
            at.append(other)
            body = link_inertia(other)
            if body is not None and body.any():
                found.append(other)
    return found


def joined(body: Element, carried: Sequence[Element]) -> str:
    """Return the remark that a body has the mass of those that are fixed to it."""
    names = ", ".join(other.attributes.get("name", "one without a name") for other in carried)
    return f"{body.attributes.get('name', 'a body')} has the mass of what is fixed to it as well ({names})"
