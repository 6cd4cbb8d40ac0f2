// A reader of MCAP files that shares no code with ours: counts the messages of each topic by the
// file's index, decodes all, and tells the schemas that are no JSON.
//
//   node conformance/mcap.mjs FILE
import { open } from "node:fs/promises";
import { McapIndexedReader } from "@mcap/core";
import { decompress } from "fzstd";

const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, size) => {
    const buffer = new Uint8Array(Number(size));
    const { bytesRead } = await file.read(buffer, 0, buffer.length, Number(offset));
    if (bytesRead !== buffer.length) throw new Error(`short read at ${offset}`);
    return buffer;
  },
};
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: { zstd: (chunk) => decompress(chunk) },
});
const counts = new Map();
const decoder = new TextDecoder("utf-8", { fatal: true });
for (const schema of reader.schemasById.values()) {
  if (schema.encoding === "jsonschema") JSON.parse(decoder.decode(schema.data));
}
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  if (channel.messageEncoding === "json") JSON.parse(decoder.decode(message.data));
  counts.set(channel.topic, (counts.get(channel.topic) ?? 0) + 1);
}
for (const topic of [...counts.keys()].sort()) console.log(`${topic} ${counts.get(topic)}`);
await file.close();
