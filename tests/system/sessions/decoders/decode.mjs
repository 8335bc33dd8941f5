// SPDX-License-Identifier: Apache-2.0
// Reads every message of an MCAP file with decoders of others: node decode.mjs FILE, in a folder where package.json's packages
// are. Prints as JSON what they make of it; any message that does not decode ends it.
import {readFileSync} from 'node:fs';
import {McapIndexedReader} from '@mcap/core';
import {parseIDL} from '@foxglove/omgidl-parser';
import {MessageReader as IdlReader} from '@foxglove/omgidl-serialization';
import {parse as parseRos} from '@foxglove/rosmsg';
import {MessageReader as RosReader} from '@foxglove/rosmsg2-serialization';

const bytes = readFileSync(process.argv[2]);
const file = await McapIndexedReader.Initialize({
  readable: {
    size: async () => BigInt(bytes.length),
    read: async (offset, length) => bytes.subarray(Number(offset), Number(offset + length)),
  },
});
const text = new TextDecoder();
const readers = new Map();
for (const channel of file.channelsById.values()) {
  const schema = file.schemasById.get(channel.schemaId);
  const definition = text.decode(schema.data);
  readers.set(channel.id, schema.encoding === 'omgidl'
    ? new IdlReader(schema.name, parseIDL(definition))
    : new RosReader(parseRos(definition, {ros2: true})));
}
const topics = {}, frames = {}, markers = {}, numbers = {};
let last = -1n, messages = 0;
for await (const message of file.readMessages()) {
  if (message.logTime < last) throw new Error('not in the order of time');
  last = message.logTime;
  ++messages;
  const channel = file.channelsById.get(message.channelId);
  const said = readers.get(channel.id).readMessage(message.data);
  topics[channel.topic] = (topics[channel.topic] ?? 0) + 1;
  for (const told of said.transforms ?? [])
    frames[told.child_frame_id] = {...told.transform.translation, ...{q: told.transform.rotation}};
  for (const marker of said.markers ?? []) {
    const kind = channel.topic.split('/').pop();
    markers[kind] ??= {sent: 0, points: 0, gone: 0, least: Infinity, most: -Infinity};
    const seen = markers[kind];
    ++seen.sent;
    seen.points += marker.points.length;
    seen.gone += marker.action === 2 ? 1 : 0;
    for (const point of marker.points) {
      seen.least = Math.min(seen.least, point.z);
      seen.most = Math.max(seen.most, point.z);
    }
  }
  if (typeof said.data === 'number' && channel.topic.endsWith('_m'))
    (numbers[channel.topic.split('/').slice(3).join('/')] ??= []).push(said.data);
}
const counted = file.statistics?.messageCount;
if (counted !== BigInt(messages)) throw new Error(`${messages} messages, of ${counted}`);
console.log(JSON.stringify({topics, frames, markers, numbers}, (key, value) =>
  typeof value === 'bigint' ? Number(value) : value));
