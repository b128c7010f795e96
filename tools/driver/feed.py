#!/usr/bin/env python3
"""Feeds messages from a file in lockstep: each word of the clock waits for the arbiter's answer to the one before.

    feed.py MESSAGES        with sidestep.py (`sidestep interface --python`) beside this file

The file holds messages in the order in which a lockstep driver sent them, each as topic index (u64), graph time of the
step (u64, ns), bytes (u64), and those bytes. The commands change nothing here: the drive is open loop, and exact.
"""
import ctypes
import struct
import sys
import sidestep

ROWS = list(sidestep.TOPICS.values())


def messages(path):
    with open(path, "rb") as file:
        while head := file.read(24):
            topic, now_ns, size = struct.unpack("=QQQ", head)
            yield ROWS[topic], now_ns, file.read(size)


link, writers, waiting = sidestep.Link(), {}, None
if not link.lockstep:
    raise sidestep.Refused(2, 'feed.py: the graph has time = "real", needed: time = "lockstep"')
link.begin()
for row, now_ns, content in messages(sys.argv[1]):
    is_frame = row.name in ("depth", "scan")
    if waiting is not None and not is_frame:
        link.answer(waiting)  # the clock's last word was a tick
    waiting = None
    if link.stopping:
        break
    if row.name == "clock":
        link.say(now_ns)
        waiting = now_ns
        continue
    writer = writers.get(row.name) or writers.setdefault(row.name, sidestep.Writer(link, row.name))
    ctypes.memmove(ctypes.addressof(writer.message), content, len(content))
    writer.send(now_ns)
    if is_frame:
        link.answer(now_ns, frame=writer.sequence)
if waiting is not None:
    link.answer(waiting)
