"""Files that an MJCF includes and shows, named from the folder that it is written to."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from elid_cli.robot.urdf.xml import Element
from elid_cli.robot.xml_edit import XmlEdit

SHAPES, IMAGES = ("mesh", "skin", "hfield"), ("texture",)
PLACES = {"meshdir": SHAPES, "texturedir": IMAGES, "assetdir": (*SHAPES, *IMAGES)}
"""Attribute of an MJCF's compiler that names a folder -> the elements whose files are in it."""


def name_from(edit: XmlEdit, old: Path, new: Path) -> None:
    """Name the files that an MJCF in one folder includes and shows from another one."""
    if old.resolve() == new.resolve():
        return

    def moved(element: Element, attribute: str) -> None:
        place = element.attributes.get(attribute)
        if place is not None and not Path(place).is_absolute():
            there = os.path.relpath((old / place).resolve(), new.resolve())
            edit.set_attributes(element, {attribute: Path(there).as_posix()})

    every = list(elements(edit.root))
    said = {name for element in every if element.tag == "compiler" for name in element.attributes}
    named = {tag for attribute, tags in PLACES.items() if attribute in said for tag in tags}
    for element in every:
        if element.tag == "include" or (element.tag in PLACES["assetdir"] and element.tag not in named):
            moved(element, "file")
        for attribute in PLACES if element.tag == "compiler" else ():
            moved(element, attribute)


def elements(element: Element) -> Iterator[Element]:
    """Yield an element and all that it holds."""
    yield element
    for child in element.children:
        yield from elements(child)
