"""What an HDF5 file holds: its datasets of numbers, and why others are not read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from elid_cli.budget import MOST_AT_ONCE

MOST_ENTRIES = 20_000
DEEPEST = 20
WIDEST = 1_000
"""Values per sample of an array that is a signal of some joints."""
MOST_REFERENCES = 64
MOST_SIZES = 32
"""Dimensions of an array, at most (HDF5)."""
LARGE, TIGHT = 256 << 20, 20
"""Bytes from which a dataset is believed only if the file has a twentieth of them: measurements pack no tighter."""


def contents(file: Any) -> tuple[dict[str, Any], dict[str, str]]:
    """Return (dataset by path, reason by path of what is not read) of an open file.

    Raises
    ------
    ValueError
        If the file has too many entries.
    """
    datasets: dict[str, Any] = {}
    refused: dict[str, str] = {}
    soft: dict[str, str] = {}
    for path, item, reason in _walk(file, "", 0, [0]):
        if reason.startswith("->"):
            soft[path] = reason[2:]
        elif reason:
            refused[path] = reason
        elif item.dtype.kind in "fiub" and _empty_size(item):
            refused[path] = f"an array of shape {item.shape}, which the file does not hold"
        elif item.dtype.kind in "fiub":
            datasets[path] = item
        else:
            found = _referenced(file, path, item)
            datasets.update(found)
            if not found:
                refused[path] = _kind(item)
    for path, target in soft.items():
        place = target if target.startswith("/") else f"{path.rpartition('/')[0]}/{target}"
        if place in datasets:
            datasets[path] = datasets[place]
        else:
            refused[path] = f"a link to {target}, which is no array of numbers in this file"
    return datasets, refused


def _walk(group: Any, prefix: str, depth: int, seen: list[int]) -> Iterator[tuple[str, Any, str]]:
    """Yield (path, dataset, reason why it is not read) of everything below a group."""
    import h5py

    if depth > DEEPEST:
        return
    for key in group:
        seen[0] += 1
        if seen[0] > MOST_ENTRIES:
            raise ValueError(f"it has more than {MOST_ENTRIES} entries")
        path = f"{prefix}/{key}"
        link = group.get(key, getlink=True)
        if isinstance(link, h5py.SoftLink):
            yield path, None, f"->{link.path}"
        elif isinstance(link, h5py.ExternalLink):
            yield path, None, f"a link into another file ({link.filename}), which is not followed"
        elif isinstance(link, h5py.HardLink) and not key.startswith("#"):
            item = group[key]
            if isinstance(item, h5py.Group):
                yield from _walk(item, path, depth + 1, seen)
            elif isinstance(item, h5py.Dataset) and not _has_numpy_type(item):
                yield path, None, "of a type that NumPy does not have (a time?), not numbers"
            elif isinstance(item, h5py.Dataset) and item.shape is not None and not _is_empty(item):
                yield path, item, "" if item.shape or item.dtype.kind not in "fiub" else "a single number"


def _is_empty(dataset: Any) -> bool:
    """Whether it is MATLAB's empty array, which is stored as its few sizes."""
    return dataset.size <= MOST_SIZES and "MATLAB_empty" in dataset.attrs


def _empty_size(dataset: Any) -> bool:
    """Whether an array is declared far larger than the file, or than any signal."""
    size = math.prod(dataset.shape) * dataset.dtype.itemsize
    return size > MOST_AT_ONCE or bool(size > LARGE and min(dataset.shape) > WIDEST)


def _has_numpy_type(dataset: Any) -> bool:
    """Whether NumPy has a type for it; it has none for HDF5's times."""
    try:
        return dataset.dtype is not None
    except TypeError:
        return False


def _referenced(file: Any, path: str, dataset: Any) -> dict[str, Any]:
    """Return the arrays of numbers that a dataset of object references (a MATLAB cell) names; empty where it does not.

    One reference stands for the array itself; several become ``path/1``, ``path/2``, …
    """
    import h5py

    if h5py.check_ref_dtype(dataset.dtype) is not h5py.Reference or not 0 < dataset.size <= MOST_REFERENCES:
        return {}
    targets = [file[reference] for reference in dataset[()].ravel() if reference]
    if len(targets) != dataset.size:
        return {}
    if not all(isinstance(target, h5py.Dataset) and target.dtype.kind in "fiub" and target.shape for target in targets):
        return {}
    if len(targets) == 1:
        return {path: targets[0]}
    return {f"{path}/{k}": target for k, target in enumerate(targets, start=1)}


def _kind(dataset: Any) -> str:
    """Return what a dataset is that is no array of numbers."""
    import h5py

    dtype = dataset.dtype
    if h5py.check_ref_dtype(dtype) is not None:
        return "references that lead to no arrays of numbers"
    if h5py.check_string_dtype(dtype) is not None:
        return "text, not numbers"
    if h5py.check_vlen_dtype(dtype) is not None:
        return "values of variable length, not an array of numbers"
    words = {"c": "complex numbers", "V": "opaque bytes, not numbers", "O": "objects, not numbers"}
    if dtype.names:
        return f"a compound type ({', '.join(dtype.names[:6])}), not an array of numbers"
    return words.get(dtype.kind, f"of type {dtype}, not numbers")
