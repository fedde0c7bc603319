"""Equality constraints of an MJCF that close a loop: they are refused by name, as a robot is a tree."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from elid_cli.robot.robot import BASE
from elid_cli.robot.urdf.xml import Element

WORLD = "world"


def refuse_loops(
    root: Element, bodies: Mapping[str, str], sites: Mapping[str, str], read: Collection[tuple[str, int]]
) -> None:
    """Refuse what ties two bodies that different joints move, or one of them to the world.

    Parameters
    ----------
    root
        The document.
    bodies, sites
        The joint (or `BASE`) that moves each, by name.
    read
        Places of the constraints that are read as transmissions.

    Raises
    ------
    RobotError
        Naming the constraint and both its ends.
    """
    for element in (child for holder in root.all("equality") for child in holder.children):
        given = element.attributes
        if given.get("active", "true") == "false":
            continue
        if element.tag in ("connect", "weld"):
            kind, movers = ("site", sites) if "site1" in given else ("body", {WORLD: BASE, **bodies})
            one, two = given.get(f"{kind}1", WORLD), given.get(f"{kind}2", WORLD)
            if movers.get(one, one) != movers.get(two, two):
                what = f"<{element.tag}> of {kind} {one!r} to {two!r} closes a loop, which is not modelled"
                raise element.error(what, hint='take the constraint out, or set active="false"')
        if element.tag == "joint" and "joint2" in given and element.place not in read:
            element.fault(f"{given.get('joint1', '')} follows another joint in the file; here it is one of its own")
