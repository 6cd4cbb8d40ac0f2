"""Prints what a flight log holds, as the stock Python reader sees it.

Usage: stock_reader.py FILE.mcap: the number of messages per channel.
       stock_reader.py FILE.mcap FILE.mcap ...: the number of messages of each file.
Needs the package `mcap`. Checks all CRCs.
"""

import collections
import json
import sys

from mcap.reader import make_reader


def count(path):
    with open(path, "rb") as file:
        counts = collections.Counter()
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            if channel.message_encoding == "json":
                json.loads(message.data)
            counts[channel.topic] += 1
    return counts


if len(sys.argv) == 2:
    for topic, number in sorted(count(sys.argv[1]).items()):
        print(topic, number)
else:
    for path in sys.argv[1:]:
        print(sum(count(path).values()), "messages")
