// Reads an MCAP file with @mcap/core, every checksum validated, and prints what it found as JSON.
const { open } = require("node:fs/promises");
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");
const { FileHandleReadable } = require("@mcap/nodejs");

async function main(path) {
  const handle = await open(path, "r");
  const decompressHandlers = await loadDecompressHandlers();
  const reader = await McapIndexedReader.Initialize({ readable: new FileHandleReadable(handle), decompressHandlers });
  const counts = {};
  let last = -1n;
  let falls = 0;
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const topic = reader.channelsById.get(message.channelId).topic;
    counts[topic] = (counts[topic] ?? 0) + 1;
  }
  const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  const buffer = new Uint8Array(65536);
  for (;;) {
    const { bytesRead } = await handle.read(buffer, 0, buffer.length);
    if (bytesRead === 0) break;
    stream.append(buffer.slice(0, bytesRead));
    for (let record = stream.nextRecord(); record; record = stream.nextRecord()) {
      if (record.type !== "Message") continue;
      falls += record.logTime < last ? 1 : 0;
      last = record.logTime;
    }
  }
  await handle.close();
  const schemas = [...reader.schemasById.values()].map((schema) => [schema.name, schema.encoding]);
  process.stdout.write(JSON.stringify({ counts, falls, done: stream.done(), schemas, chunks: reader.chunkIndexes.length }));
}

main(process.argv[2]).catch((error) => {
  process.stderr.write(`${error}\n`);
  process.exit(1);
});
