"""LCM logs, damaged ones too: what is no event of ours is passed over."""

import mmap
import os
import struct

from sogm_swarm import codec

SYNC = struct.pack(">I", 0xEDA1DA01)
EVENT = struct.Struct(">4sqqii")  # sync word, number, time, bytes of the channel's name and of the message
MAX_CHANNEL = 63


def events(path):
    """Every event: when it was logged [us since the epoch], channel, bytes."""
    if os.path.getsize(path) == 0:
        return
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at = 0
        while 0 <= (at := data.find(SYNC, at)) <= len(data) - EVENT.size:
            _, _, utime, name_bytes, message_bytes = EVENT.unpack_from(data, at)
            name = at + EVENT.size
            message, end = name + name_bytes, name + name_bytes + message_bytes
            # Another one or nothing must follow, or the lengths are wrong.
            if not 0 < name_bytes <= MAX_CHANNEL or message_bytes < 0 or data[end:end + 4] != SYNC and end != len(data):
                at += 1
                continue
            yield utime, data[name:message].decode(errors="replace"), data[message:end]
            at = end


def messages(path, channel):
    """Every good message of a channel: when it was logged [us since the epoch], and the message."""
    message_type = None
    for utime, name, data in events(path):
        if name != channel:
            continue
        message_type = message_type or codec.type_of(data)
        try:
            if message_type:
                yield utime, codec.decode(data, message_type)
        except codec.Refused:
            pass


def arrays(path, channel):
    """The messages of a channel, {field: numpy array}, an entry (a row, where the field is an array) for each message.

    Fields of fields have dots, "header.utime". What has a length of its own in every message, and lists of messages, are
    arrays of objects. "logged" is when they were logged [us since the epoch]. Without messages there is nothing else."""
    try:
        import numpy
    except ImportError as error:
        raise ImportError("sogm_swarm.logs.arrays() needs numpy: apt install python3-numpy") from error
    logged = list(messages(path, channel))
    found = {"logged": numpy.array([utime for utime, _ in logged], dtype=numpy.int64)}
    if logged:
        found.update(_columns(numpy, [message for _, message in logged], ""))
    return found


def _columns(numpy, rows, prefix):
    empty = type(rows[0])()
    for name in empty.__slots__:
        values, usual = [getattr(row, name) for row in rows], getattr(empty, name)
        if hasattr(usual, "__slots__"):
            yield from _columns(numpy, values, prefix + name + ".")
            continue
        is_regular = not isinstance(usual, (list, bytes, str)) or (len(usual) > 0 and not hasattr(usual[0], "__slots__"))
        if is_regular:
            column = numpy.array(values)
        else:
            column = numpy.empty(len(values), dtype=object)
            for row, value in enumerate(values):
                column[row] = value
        yield prefix + name, column
