"""Images in flight logs, as the stock reader has them; their protobuf is read here by the field numbers
of the published schemas."""

import struct
import sys

from mcap.reader import make_reader


def fields(data):
    """The fields of a message: number to list of values, sub-messages and packed lists as bytes."""
    found, at = {}, 0

    def varint():
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if not byte & 0x80:
                return value

    while at < len(data):
        key = varint()
        number, kind = key >> 3, key & 7
        if kind == 0:
            value = varint()
        elif kind == 1:
            value = struct.unpack_from("<d", data, at)[0]
            at += 8
        elif kind == 5:
            value = struct.unpack_from("<I", data, at)[0]
            at += 4
        else:
            assert kind == 2, kind
            length = varint()
            value = data[at : at + length]
            at += length
        found.setdefault(number, []).append(value)
    return found


def doubles(value):
    return struct.unpack(f"<{len(value) // 8}d", value)


images, calibrations, places = {}, {}, {}
KINDS = {
    "image": ("foxglove.CompressedImage", images),
    "calibration": ("foxglove.CameraCalibration", calibrations),
    "tf": ("foxglove.FrameTransform", places),
}
for path in sys.argv[1:]:
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if not channel.topic.startswith("/camera/"):
                continue
            camera, kind = channel.topic.rsplit("/", 1)
            name, found = KINDS[kind]
            assert (schema.name, schema.encoding) == (name, "protobuf")
            assert channel.message_encoding == "protobuf" and name.split(".")[1].encode() in schema.data
            found[(camera, message.publish_time)] = fields(message.data)

for key, image in images.items():
    pair, side = key[0].split("/")[2:]
    frame = f"{pair}_{side}".encode()
    png = image[2][0]
    assert image[3] == [b"png"] and image[4] == [frame]
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", png[16:24])
    calibration, place = calibrations[key], places[key]
    assert (calibration[2], calibration[3]) == ([width], [height]), calibration
    assert calibration[4] == [b"plumb_bob"] and calibration[9] == [frame]
    k, p = doubles(calibration[6][0]), doubles(calibration[8][0])
    assert len(k) == 9 and len(p) == 12 and k[0] > 0 and k[8] == 1
    assert abs(k[2] - (width - 1) / 2) < 1e-6, "the principal point is in the middle"
    assert place[2] == [b"world"] and place[3] == [frame]
    q = [value[0] for value in fields(place[5][0]).values()]
    assert abs(sum(value * value for value in q) - 1) < 1e-9

print(f"{len(images)} images, {len(calibrations)} calibrations, {len(places)} places")
