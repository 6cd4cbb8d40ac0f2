"""Prints the number of messages per channel of a flight log, as the stock Python reader sees it.

Usage: stock_reader.py FILE.mcap. Needs the package `mcap`. Checks all CRCs.
"""

import collections
import json
import sys

from mcap.reader import make_reader

with open(sys.argv[1], "rb") as file:
    counts = collections.Counter()
    for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
        json.loads(message.data)
        counts[channel.topic] += 1

for topic, count in sorted(counts.items()):
    print(topic, count)
