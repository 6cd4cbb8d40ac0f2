"""Prints what MCAP files say, as the stock Python reader has it: one line of JSON for each.

Usage: variants.py FOLDER. Needs the package `mcap`. Checks all CRCs. Files whose name says that they
have a whole index are read by that, too.
"""

import json
import pathlib
import sys

from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, Message, Metadata
from mcap.stream_reader import StreamReader


def line(topic, m):
    return [topic, m.sequence, m.log_time, m.publish_time, m.data.decode()]


def streamed(path):
    said = {"messages": [], "attachments": [], "metadata": []}
    topics = {}
    with open(path, "rb") as file:
        for record in StreamReader(file, validate_crcs=True).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                said["messages"].append(line(topics[record.channel_id], record))
            elif isinstance(record, Attachment):
                times = [record.log_time, record.create_time]
                said["attachments"].append([record.name, *times, record.media_type, record.data.hex()])
            elif isinstance(record, Metadata):
                said["metadata"].append([record.name, record.metadata])
    return said


for path in sorted(pathlib.Path(sys.argv[1]).iterdir()):
    said = streamed(path)
    features = path.stem.split("-")
    whole = {"ch", "mx", "chx", "rch", "st"} <= set(features)
    if whole and ("rsh" in features or "Schemaless" in path.stem):
        with open(path, "rb") as file:
            messages = SeekingReader(file, validate_crcs=True).iter_messages()
            found = [line(channel.topic, message) for _, channel, message in messages]
        assert found == said["messages"], path
    print(json.dumps({"name": path.name, **said}))
