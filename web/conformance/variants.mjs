// What MCAP files say, as a reader that shares no code with ours has it: one line of JSON for each.
// Files whose name says that they have a whole index, and nothing added to records, are read by that, too.
//
//   node conformance/variants.mjs FOLDER
import { open, readFile, readdir } from "node:fs/promises";
import { join } from "node:path";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";

const text = (bytes) => new TextDecoder("utf-8", { fatal: true }).decode(bytes);
const hex = (bytes) => Buffer.from(bytes).toString("hex");
const message = (topic, m) => [
  topic,
  m.sequence,
  Number(m.logTime),
  Number(m.publishTime),
  text(m.data),
];

async function streamed(path) {
  const reader = new McapStreamReader({ validateCrcs: true });
  reader.append(await readFile(path));
  const said = { messages: [], attachments: [], metadata: [] };
  const topics = new Map();
  for (let record; (record = reader.nextRecord());) {
    if (record.type === "Channel") topics.set(record.id, record.topic);
    if (record.type === "Message")
      said.messages.push(message(topics.get(record.channelId), record));
    if (record.type === "Attachment") {
      const times = [Number(record.logTime), Number(record.createTime)];
      said.attachments.push([record.name, ...times, record.mediaType, hex(record.data)]);
    }
    if (record.type === "Metadata") {
      said.metadata.push([record.name, Object.fromEntries(record.metadata)]);
    }
  }
  if (!reader.done()) throw new Error(`${path}: the end is missing`);
  return said;
}

async function indexed(path) {
  const file = await open(path);
  const read = async (offset, size) => {
    const buffer = new Uint8Array(Number(size));
    await file.read(buffer, 0, buffer.length, Number(offset));
    return buffer;
  };
  const size = async () => BigInt((await file.stat()).size);
  const reader = await McapIndexedReader.Initialize({ readable: { size, read } });
  const messages = [];
  for await (const m of reader.readMessages()) {
    messages.push(message(reader.channelsById.get(m.channelId).topic, m));
  }
  await file.close();
  return messages;
}

const folder = process.argv[2];
let byIndex = 0;
for (const name of (await readdir(folder)).sort()) {
  const path = join(folder, name);
  const said = await streamed(path);
  const has = (feature) => name.includes(`-${feature}`);
  const whole = ["ch", "mx", "chx", "rch", "st"].every(has);
  // By the index it does not read records that are longer than their fields.
  if (whole && (has("rsh") || name.includes("Schemaless")) && !has("pad")) {
    const messages = await indexed(path);
    if (JSON.stringify(messages) !== JSON.stringify(said.messages)) {
      throw new Error(`${name}: by the index ${JSON.stringify(messages)}`);
    }
    byIndex += 1;
  }
  console.log(JSON.stringify({ name, ...said }));
}
console.error(`${byIndex} files were read by their index, too`);
