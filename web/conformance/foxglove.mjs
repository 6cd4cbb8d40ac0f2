// A viewer: the client of the Foxglove WebSocket protocol that others use, on our route. It subscribes
// to every channel and writes what comes as lines `topic TAB time TAB payload`, until there are
// enough of JSON; payloads of other encodings are in base64.
//
//   node conformance/foxglove.mjs URL SUBPROTOCOL COUNT FILE
import { closeSync, openSync, writeSync } from "node:fs";
import protocol from "@foxglove/ws-protocol";

const [url, subprotocol, count, path] = process.argv.slice(2);
const file = openSync(path, "w");
const topics = new Map();
let lines = 0;

const client = new protocol.FoxgloveClient({ ws: new WebSocket(url, [subprotocol]) });

function end(status, why) {
  if (why) console.error(why);
  client.close();
  closeSync(file);
  process.exit(status);
}

client.on("error", (error) => end(2, `error: ${error?.message ?? error}`));
client.on("close", () => end(3, `closed after ${lines} messages`));
client.on("status", (event) => end(4, `status: ${event.message}`));
client.on("serverInfo", (event) => {
  if (event.capabilities.some((name) => name !== "time")) end(5, "this route is read-only");
});
client.on("advertise", (channels) => {
  for (const channel of channels) {
    const isJson = channel.encoding === "json";
    if (isJson) JSON.parse(channel.schema);
    topics.set(client.subscribe(channel.id), { name: channel.topic, isJson });
  }
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { name, isJson } = topics.get(subscriptionId);
  const bytes = Buffer.from(data.buffer, data.byteOffset, data.byteLength);
  writeSync(file, `${name}\t${timestamp}\t${bytes.toString(isJson ? "utf8" : "base64")}\n`);
  if (isJson) lines += 1;
  if (lines >= Number(count)) end(0);
});
