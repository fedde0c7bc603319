"""Chunks of an MCAP file unpacked; whatever lies about its size is refused before memory is taken for it."""

from __future__ import annotations

import struct
import zlib

from elid_cli.budget import Budget

LARGEST_CHUNK = 1 << 30
"""Bytes of an uncompressed chunk that are still accepted."""
DENSEST = 20_000
"""Uncompressed bytes per compressed byte that are still believed."""


def decompressed(body: bytes, budget: Budget) -> bytes:
    """Return the records of a chunk record's body (ValueError or struct.error where it is damaged or lies)."""
    uncompressed, crc, name_length = struct.unpack_from("<QII", body, 16)
    compression = body[32 : 32 + name_length].decode()
    (length,) = struct.unpack_from("<Q", body, 32 + name_length)
    begin = 40 + name_length
    if length > len(body) - begin:
        raise ValueError(f"declares {length} bytes but holds {len(body) - begin}")
    if uncompressed > LARGEST_CHUNK or uncompressed > DENSEST * max(length, 64):
        raise ValueError(f"declares {uncompressed} bytes of content in {length}")
    budget.take(uncompressed)
    packed = memoryview(body)[begin : begin + length]
    if compression == "zstd":
        records = _zstd(packed, uncompressed)
    elif compression == "lz4":
        records = _lz4(packed, uncompressed)
    elif compression in ("", "none"):
        records = bytes(packed)
    else:
        raise ValueError(f"unknown compression {compression!r}")
    if len(records) != uncompressed:
        raise ValueError(f"declares {uncompressed} bytes of content but holds {len(records)}")
    if crc and zlib.crc32(records) != crc:
        raise ValueError("checksum differs")
    return records


def _zstd(packed: memoryview, size: int) -> bytes:
    import zstandard

    try:
        declared = zstandard.frame_content_size(packed)
        if declared > size:
            raise ValueError(f"frame declares {declared} bytes, the chunk {size}")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ValueError(f"zstd: {error}") from error


def _lz4(packed: memoryview, size: int) -> bytes:
    import lz4.frame

    try:
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    except (RuntimeError, EOFError) as error:
        raise ValueError(f"lz4: {error}") from error
