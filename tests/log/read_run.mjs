// Copyright 2026 The RPO stack authors
// SPDX-License-Identifier: Apache-2.0
// Reads a run with the JavaScript MCAP reader that Foxglove and Lichtblick use; prints what it read.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { argv, cwd, stdout } from 'node:process';

const require = createRequire(`${cwd()}/`);
const { McapIndexedReader } = require('@mcap/core');
const { parse } = require('@foxglove/rosmsg');
const { MessageReader } = require('@foxglove/rosmsg2-serialization');
const fzstd = require('fzstd');

const content = readFileSync(argv[2]);
const readable = {
  size: async () => BigInt(content.length),
  read: async (offset, length) =>
    new Uint8Array(content.subarray(Number(offset), Number(offset + length))),
};
const decompressHandlers = { zstd: (data, size) => fzstd.decompress(data, new Uint8Array(Number(size))) };
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });

const readers = new Map();
for (const channel of reader.channelsById.values()) {
  const schema = reader.schemasById.get(channel.schemaId);
  const definitions = parse(new TextDecoder().decode(schema.data), { ros2: true });
  readers.set(channel.id, [channel.topic, new MessageReader(definitions)]);
}
const counts = {};
const states = [];
const forces = [];
for await (const message of reader.readMessages()) {
  const [topic, decoder] = readers.get(message.channelId);
  const value = decoder.readMessage(message.data);
  counts[topic] = (counts[topic] ?? 0) + 1;
  if (topic === '/relative_state') {
    const { position: p } = value.pose.pose;
    const { linear: v } = value.twist.twist;
    states.push([p.x, p.y, p.z, v.x, v.y, v.z]);
  } else if (topic === '/control_force') {
    const { force: f } = value.wrench;
    forces.push([f.x, f.y, f.z]);
  }
}
stdout.write(JSON.stringify({ counts, states, forces }));
