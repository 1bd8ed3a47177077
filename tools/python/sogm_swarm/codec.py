"""Messages as bytes, and what is checked before bytes are believed. Ranges of values are not: daemons look at those."""

import struct
import zlib

import sogm_swarm

HEADER_BYTES = 36  # fingerprint and header; the CRC is at 8, of all that follows it
SEAL, SEAL_BYTES = b"SEAL", 20  # after what is sent on the swarm bus; not looked at here


class Refused(ValueError):
    """Bytes that are no message, or another one than was asked for; says why."""


def encode(message):
    data = bytearray(message.encode())
    data[8:12] = struct.pack(">I", zlib.crc32(data[12:]))
    return bytes(data)


def decode(data, message_type):
    if data[-SEAL_BYTES:-SEAL_BYTES + len(SEAL)] == SEAL:
        data = data[:-SEAL_BYTES]
    if len(data) < HEADER_BYTES:
        raise Refused(f"{len(data)} bytes are too short for a message")
    if data[:8] != message_type._get_packed_fingerprint():
        raise Refused(f"this is no {message_type.__name__}, or that of another version")
    if struct.unpack(">I", data[8:12])[0] != zlib.crc32(data[12:]):
        raise Refused("damaged: its CRC is wrong")
    try:
        message = message_type.decode(data)
    except struct.error as error:
        raise Refused("shorter than its own counts say") from error
    if message.header.schema_version != sogm_swarm.header_t.kSchemaVersion:
        raise Refused(f"schema version {message.header.schema_version}, not {sogm_swarm.header_t.kSchemaVersion}")
    return message


def type_of(data):
    """The type that a message's bytes begin with; None: none of ours."""
    for name in dir(sogm_swarm):
        message_type = getattr(sogm_swarm, name)
        if name.endswith("_t") and message_type._get_packed_fingerprint() == data[:8]:
            return message_type
    return None
