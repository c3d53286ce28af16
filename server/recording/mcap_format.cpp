#include "server/recording/mcap_format.h"

#include <zlib.h>

#include <utility>

namespace palpate::mcap {
namespace {

void Put(ByteWriter& writer, const Texts& texts) {
  ByteWriter list;
  for (const auto& [key, text] : texts) {
    list.PutText(key);
    list.PutText(text);
  }
  writer.PutText(list.bytes());
}

Texts GetTexts(ByteReader& reader) {
  ByteReader list(reader.GetBytes(reader.Get<std::uint32_t>()));
  Texts texts;
  while (!list.at_end()) {
    std::string key = list.GetText();
    // Other programs put whole files into them.
    texts[std::move(key)] = list.GetText(kMostRecordBytes);
  }
  return texts;
}

}  // namespace

std::uint32_t Crc(std::uint32_t before, std::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

std::string Frame(Opcode opcode, std::string_view content) {
  ByteWriter writer;
  writer.Put(static_cast<std::uint8_t>(opcode));
  writer.Put(static_cast<std::uint64_t>(content.size()));
  writer.PutBytes(content);
  return std::move(writer).Take();
}

std::string Encode(const Schema& schema) {
  ByteWriter writer;
  writer.Put(schema.id);
  writer.PutText(schema.name);
  writer.PutText(schema.encoding);
  writer.PutText(schema.data);
  return Frame(Opcode::kSchema, writer.bytes());
}

std::string Encode(const Channel& channel) {
  ByteWriter writer;
  writer.Put(channel.id);
  writer.Put(channel.schema);
  writer.PutText(channel.topic);
  writer.PutText(channel.encoding);
  Put(writer, channel.metadata);
  return Frame(Opcode::kChannel, writer.bytes());
}

std::string Encode(const Metadata& metadata) {
  ByteWriter writer;
  writer.PutText(metadata.name);
  Put(writer, metadata.texts);
  return Frame(Opcode::kMetadata, writer.bytes());
}

std::string Encode(const ChunkIndex& index) {
  ByteWriter writer, places;
  for (const auto& [channel, place] : index.message_indexes) {
    places.Put(channel);
    places.Put(place);
  }
  writer.Put(index.first_time_ns);
  writer.Put(index.last_time_ns);
  writer.Put(index.place);
  writer.Put(index.bytes);
  writer.PutText(places.bytes());
  writer.Put(index.message_index_bytes);
  writer.PutText(index.packing);
  writer.Put(index.packed_bytes);
  writer.Put(index.unpacked_bytes);
  return Frame(Opcode::kChunkIndex, writer.bytes());
}

std::string NameOfSchema(std::string_view content) {
  ByteReader reader(content);
  reader.Get<std::uint16_t>();
  return reader.GetText();
}

Channel DecodeChannel(std::string_view content) {
  ByteReader reader(content);
  Channel channel;
  channel.id = reader.Get<std::uint16_t>();
  channel.schema = reader.Get<std::uint16_t>();
  channel.topic = reader.GetText();
  channel.encoding = reader.GetText();
  channel.metadata = GetTexts(reader);
  return channel;
}

Metadata DecodeMetadata(std::string_view content) {
  ByteReader reader(content);
  Metadata metadata;
  metadata.name = reader.GetText();
  metadata.texts = GetTexts(reader);
  return metadata;
}

}  // namespace palpate::mcap
