"""Records from WAV files of any number of channels.

The samples are integers of 8 to 64 bits or floats. Full scale is 1.
"""

import struct
import warnings
from pathlib import Path
from typing import NoReturn

import numpy as np
import scipy

from impact_env.checks import ParameterError, require
from impact_env.records.channels import Channel, RecordOptions, choose_channel, require_finite

CHUNK_HEAD = 8  # bytes: name and size
RIFF_HEAD = 12  # bytes: RIFF, size, WAVE
WAV_BYTE_ORDERS = {b"RIFF": "<", b"RIFX": ">"}
SAMPLE_BITS = (
    8,
    16,
    24,
    32,
    64,
)  # of a sample; with others it is not clear which bits of a word they are


def _refuse(file: Path, allowed: str) -> NoReturn:
    raise ParameterError(f"file = {file.name!r} is not allowed: {allowed}")


def _require_whole(file: Path) -> None:
    """Raise ParameterError unless a file has exactly the bytes that its header announces.

    These are the bytes of its header and chunks, and no others.
    """
    content = file.read_bytes()
    order = WAV_BYTE_ORDERS.get(content[:4])
    if len(content) < RIFF_HEAD or order is None or content[8:RIFF_HEAD] != b"WAVE":
        _refuse(file, "a WAV file, which begins with RIFF and WAVE")
    announced = struct.unpack_from(f"{order}I", content, 4)[0] + CHUNK_HEAD
    allowed = f"a whole WAV file, with the {announced} bytes of its header"
    whole = announced <= len(content) and not content[announced:].strip(b"\0")
    require(whole, f"{file.name}: bytes", len(content), allowed)
    chunks: dict[bytes, bytes] = {}
    at = RIFF_HEAD
    while at + CHUNK_HEAD <= announced:
        name, length = struct.unpack_from(f"{order}4sI", content, at)
        at += CHUNK_HEAD
        where = f"{file.name}: chunk {name.decode('latin-1')!r}"
        allowed = f"at most the {announced - at} bytes that follow: a whole WAV file"
        require(at + length <= announced, where, f"{length} bytes", allowed)
        require(name not in chunks or name != b"data", where, "a second one", "one")
        chunks[name] = content[at : at + length]
        at += length + length % 2
    for name in (b"fmt ", b"data"):
        if name not in chunks:
            _refuse(file, f"a whole WAV file; it has no chunk {name.decode()!r}")
    require(
        len(chunks[b"fmt "]) >= 16,
        f"{file.name}: chunk 'fmt '",
        f"{len(chunks[b'fmt '])} bytes",
        "16 or more",
    )
    _, channels, rate, _, block, bits = struct.unpack_from(f"{order}HHIIHH", chunks[b"fmt "])
    require(
        bits in SAMPLE_BITS,
        f"{file.name}: bits of a sample",
        bits,
        f"one of {', '.join(map(str, SAMPLE_BITS))}",
    )
    require(channels > 0, f"{file.name}: channels", channels, "1 or more")
    require(rate > 0, f"{file.name}: sampling rate", rate, "above 0 Hz")
    require(
        block == channels * bits // 8,
        f"{file.name}: bytes of a sample of all channels",
        block,
        f"{channels * bits // 8}, {channels} channels of {bits} bits",
    )
    size = len(chunks[b"data"])
    require(
        size > 0 and size % block == 0,
        f"{file.name}: chunk 'data'",
        f"{size} bytes",
        f"one or more samples of {block} bytes, whole",
    )


def read_wav(file: Path, options: RecordOptions) -> Channel:
    """Return a channel of a sound file, with the file's own rate; full scale is 1."""
    allowed = f"given for {file.name}, in N or m/s^2 for full scale, as a sound has no unit"
    require(options.scale is not None, "scale", None, allowed)
    _require_whole(file)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", scipy.io.wavfile.WavFileWarning
            )  # of chunks beside the samples
            rate, values = scipy.io.wavfile.read(file)
    except (ValueError, struct.error) as error:
        _refuse(file, f"a WAV file that can be read ({' '.join(str(error).split())})")
    values = values.reshape(len(values), -1)
    chosen = values[:, choose_channel(file, options, [""] * values.shape[1])]
    if chosen.dtype.kind == "f":
        return Channel(require_finite(file, chosen.astype(np.float64)), rate=float(rate))
    if chosen.dtype == np.uint8:  # the only unsigned format: silence is 128
        return Channel((chosen.astype(np.float64) - 128) / 128, rate=float(rate))
    return Channel(chosen / (float(np.iinfo(chosen.dtype).max) + 1), rate=float(rate))
